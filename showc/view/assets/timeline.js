// The timeline: chapters, the fleet's mean light, closest encounters, the mesh.

const ROWS = { names: [0, 17], light: [20, 22], distance: [46, 14], mesh: [63, 11] };

class Timeline {
  constructor(element, seek) {
    this.element = element;
    this.canvas = element.querySelector("canvas");
    this.head = element.querySelector("#playhead");
    this.tip = element.querySelector("#timeline-tip");
    this.drone = -1;
    const timeOf = (event) => {
      const box = element.getBoundingClientRect();
      return Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1) * show.duration;
    };
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      seek(timeOf(event));
    });
    element.addEventListener("pointermove", (event) => {
      const time = timeOf(event);
      if (event.buttons & 1) seek(time);
      this.showTip(time);
    });
    element.addEventListener("pointerleave", () => (this.tip.hidden = true));
  }

  x(time) {
    return (time / show.duration) * this.width;
  }

  showTip(time) {
    const segment = show.segments[segmentAt(time)];
    const near = show.encounters.find((e) => Math.abs(this.x(e.time) - this.x(time)) < 5);
    this.tip.textContent = near
      ? `${clockText(near.time)} · ${near.distance.toFixed(2)} m between ${near.a + 1} and ${near.b + 1}`
      : `${clockText(time)} · ${segment.name}`;
    this.tip.hidden = false;
    const half = this.tip.offsetWidth / 2;
    const left = Math.min(Math.max(this.x(time) - half, 0), this.width - 2 * half);
    this.tip.style.transform = `translateX(${left}px)`;
  }

  move(time) {
    this.head.style.transform = `translateX(${this.x(time)}px)`;
    this.element.setAttribute("aria-valuenow", time.toFixed(2));
    this.element.setAttribute("aria-valuetext", clockText(time));
  }

  draw(drone = this.drone) {
    this.drone = drone;
    this.element.setAttribute("aria-valuemax", show.duration);
    const density = window.devicePixelRatio || 1;
    this.width = this.element.clientWidth;
    this.canvas.width = this.width * density;
    this.canvas.height = this.element.clientHeight * density;
    const c = this.canvas.getContext("2d");
    c.scale(density, density);
    this.drawLight(c);
    this.drawChapters(c);
    this.drawMesh(c);
    this.drawDistances(c);
  }

  drawChapters(c) {
    const [top, height] = ROWS.names;
    c.textBaseline = "middle";
    show.segments.forEach((segment, index) => {
      const left = this.x(segment.start);
      const wide = this.x(segment.duration);
      const moving = segment.kind !== "hold";
      if (moving) {
        c.fillStyle = "rgba(125, 180, 255, 0.16)";
        c.beginPath();
        c.roundRect(left + 0.5, top, Math.max(wide - 1, 1), height, 4);
        c.fill();
        c.save();
        c.beginPath();
        // A name may run on over the hold that follows.
        const after = show.segments[index + 1];
        const room = after && after.kind === "hold" ? wide + this.x(after.duration) : wide;
        c.rect(left, top, room - 4, height);
        c.clip();
        c.font = "11px system-ui, 'DejaVu Sans', sans-serif";
        c.fillStyle = "rgba(233, 237, 246, 0.85)";
        if (room > 26) c.fillText(segment.label, left + 6, top + height / 2 + 0.5);
        c.restore();
      }
    });
  }

  // Mean colour of the fleet, brightened so that few lights show too.
  drawLight(c) {
    const [top, height] = ROWS.light;
    c.save();
    c.beginPath();
    c.roundRect(0, top, this.width, height, 5);
    c.clip();
    c.fillStyle = "#10151f";
    c.fillRect(0, top, this.width, height);
    const stride = Math.max(1, Math.floor(show.drones / 64));
    for (let x = 0; x < this.width; x++) {
      const [frame] = frameAt(((x + 0.5) / this.width) * show.duration);
      const sum = [0, 0, 0];
      for (let drone = 0; drone < show.drones; drone += stride) {
        const at = (frame * show.drones + drone) * 4;
        for (let k = 0; k < 3; k++) sum[k] += show.colours[at + k];
      }
      const count = Math.ceil(show.drones / stride);
      const [r, g, b] = sum.map((value) => Math.round(value / count));
      if (r + g + b < 3) continue;
      c.fillStyle = `rgb(${r}, ${g}, ${b})`;
      c.fillRect(x, top, 1, height);
    }
    c.restore();
    c.fillStyle = "rgba(4, 6, 12, 0.55)";
    for (const segment of show.segments)
      if (segment.kind !== "hold") c.fillRect(this.x(segment.start) - 0.5, top, 1, height);
  }

  // A dot for the nearest pair of every move, a diamond for the tightest of all.
  drawDistances(c) {
    const [top, height] = ROWS.distance;
    const middle = top + height / 2;
    for (const encounter of show.encounters) {
      const x = this.x(encounter.time);
      c.beginPath();
      if (encounter.tightest) {
        c.fillStyle = "#ff6b7a";
        c.moveTo(x, middle - 6);
        c.lineTo(x + 6, middle);
        c.lineTo(x, middle + 6);
        c.lineTo(x - 6, middle);
      } else {
        c.fillStyle = "rgba(255, 180, 84, 0.8)";
        c.arc(x, middle, 2.4, 0, 2 * Math.PI);
      }
      c.fill();
    }
  }

  // Borders of the mesh intervals: of the chosen drone, or how many drones share them.
  drawMesh(c) {
    const [top, height] = ROWS.mesh;
    c.fillStyle = "rgba(255, 255, 255, 0.04)";
    c.fillRect(0, top, this.width, height);
    show.segments.forEach((segment, index) => {
      if (segment.kind === "hold") return;
      const borders = new Map();
      const drones = this.drone >= 0 ? [this.drone] : Array.from({ length: show.drones }, (_, k) => k);
      for (const drone of drones) {
        for (const share of meshOf(index, drone)) {
          const x = Math.round(this.x(segment.start + share * segment.duration) * 2) / 2;
          borders.set(x, (borders.get(x) ?? 0) + 1);
        }
      }
      for (const [x, count] of borders) {
        const strength = 0.25 + 0.65 * (count / drones.length) ** 0.5;
        c.fillStyle = `rgba(125, 180, 255, ${strength.toFixed(3)})`;
        c.fillRect(x - 0.5, top, 1, height);
      }
    });
  }
}
