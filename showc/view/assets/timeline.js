// The timeline: chapters, the fleet's mean light, closest encounters, the mesh, a ruler
// with cues, and the music's waveform.

const FULL = { names: [0, 17], light: [20, 22], distance: [46, 14], mesh: [63, 11], ruler: [77, 24], wave: [103, 22] };
const MESHLESS = { ...FULL, ruler: [63, 24], wave: [89, 22] };
const PLAIN = { names: [0, 17], light: [20, 22], ruler: [45, 24], wave: [71, 22] };
const LANE = 14;
const MOST_LANES = 6;

// Groups that have times of their own in a leg, each in a lane.
function groupsOf(segment) {
  return [...new Set(segment.moves.map((move) => move.group))];
}

// The same rows with room for the most lanes that a leg has.
function withLanes(rows) {
  const most = Math.max(0, ...show.segments.map((segment) => groupsOf(segment).length));
  const more = Math.max(0, Math.min(most, MOST_LANES) * LANE - rows.names[1]);
  const lower = Object.entries(rows).map(([name, [top, tall]]) => [name, name === "names" ? [top, tall + more] : [top + more, tall]]);
  return Object.fromEntries(lower);
}

// What is flown at a time: of groups with times of their own, the moves of those that move.
function movingAt(segment, time) {
  const now = segment.moves.filter((move) => time >= move.start && time < move.start + move.duration);
  return now.map((move) => `${move.group}: ${move.name}`).join(", ") || segment.name;
}

// A label, shortened where there is no room for all of it; nothing for less than two letters.
function fitting(c, label, room) {
  if (c.measureText(label).width <= room) return label;
  for (let length = label.length - 1; length > 1; length--) {
    const short = `${label.slice(0, length).trimEnd()}…`;
    if (c.measureText(short).width <= room) return short;
  }
  return "";
}

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
    const cue = show.soundtrack?.cues.find((one) => Math.abs(this.x(one.time) - this.x(time)) < 4);
    const finding = markedFindings().find((one) => Math.abs(this.x(one.time) - this.x(time)) < 5);
    const near = !display.client && show.encounters.find((e) => Math.abs(this.x(e.time) - this.x(time)) < 5);
    this.tip.textContent = near
      ? `${clockText(near.time)} · ${near.distance.toFixed(2)} m between ${near.a + 1} and ${near.b + 1}`
      : finding
        ? `${clockText(finding.time)} · ${finding.code}: ${finding.message}`
        : `${clockText(cue ? cue.time : time)} · ${cue ? cue.name : movingAt(segment, time)}`;
    if (!near && !finding && display.tubes && segment.tube) this.tip.textContent += ` · tube ${segment.tube.toFixed(2)} m`;
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
    this.rows = withLanes(display.client ? PLAIN : show.meshes.length > 1 ? FULL : MESHLESS);
    const [last, tall] = sound.peaks ? this.rows.wave : this.rows.ruler;
    this.element.style.height = `${last + tall}px`;
    const foot = this.element.closest("footer").offsetHeight;
    document.documentElement.style.setProperty("--foot", `${foot}px`);
    this.width = this.element.clientWidth;
    this.canvas.width = this.width * density;
    this.canvas.height = this.element.clientHeight * density;
    const c = this.canvas.getContext("2d");
    c.scale(density, density);
    this.drawLight(c);
    this.drawChapters(c);
    this.drawRuler(c);
    if (sound.peaks) this.drawWave(c);
    if (display.client) return;
    if (this.rows.mesh) this.drawMesh(c);
    this.drawDistances(c);
    this.drawFindings(c);
  }

  // A triangle on the ruler wherever something was found.
  drawFindings(c) {
    const [top, height] = this.rows.ruler;
    for (const finding of markedFindings()) {
      const x = this.x(finding.time);
      c.fillStyle = finding.severity === "error" ? "#ff6b7a" : "#ffb454";
      c.beginPath();
      c.moveTo(x, top + height - 9);
      c.lineTo(x + 5, top + height);
      c.lineTo(x - 5, top + height);
      c.fill();
    }
  }

  // Ticks at round times, bars where there is room, and cues with their names.
  drawRuler(c) {
    const [top] = this.rows.ruler;
    const least = (70 / this.width) * show.duration;
    const step = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600].find((one) => one >= least) ?? 1200;
    c.font = "10px system-ui, 'DejaVu Sans', sans-serif";
    c.textBaseline = "middle";
    const { cues, bar, first_bar: first } = show.soundtrack ?? { cues: [], bar: 0, first_bar: 0 };
    if (bar > 0 && this.x(bar) >= 4) {
      c.fillStyle = "rgba(255, 180, 84, 0.35)";
      for (let time = first; time <= show.duration; time += bar)
        if (time >= 0) c.fillRect(this.x(time), top, 1, 3);
    }
    for (let time = 0; time <= show.duration; time += step) {
      c.fillStyle = "rgba(255, 255, 255, 0.35)";
      c.fillRect(this.x(time), top, 1, 5);
      c.fillStyle = "rgba(141, 152, 174, 0.9)";
      const text = clockText(time, 0);
      const left = Math.min(this.x(time) + 3, this.width - c.measureText(text).width - 1);
      c.fillText(text, left, top + 6);
    }
    let free = 0;
    for (const cue of cues) {
      if (cue.time < 0 || cue.time > show.duration) continue;
      const x = this.x(cue.time);
      c.fillStyle = "#ffb454";
      c.fillRect(x - 0.5, top, 1, 24);
      if (x < free) continue;
      c.fillText(cue.name, Math.min(x + 3, this.width - c.measureText(cue.name).width), top + 18);
      free = x + c.measureText(cue.name).width + 8;
    }
  }

  drawWave(c) {
    const [top, height] = this.rows.wave;
    const { peaks, rate } = sound;
    c.fillStyle = "rgba(125, 180, 255, 0.55)";
    for (let x = 0; x < this.width; x++) {
      const time = (x / this.width) * show.duration - soundOffset();
      const next = ((x + 1) / this.width) * show.duration - soundOffset();
      let most = 0;
      for (let k = Math.max(Math.floor(time * rate), 0); k <= next * rate && k < peaks.length; k++) most = Math.max(most, peaks[k]);
      if (most > 0) c.fillRect(x, top + (height * (1 - most)) / 2, 1, Math.max(height * most, 1));
    }
  }

  drawChapters(c) {
    const [top, height] = this.rows.names;
    c.textBaseline = "middle";
    show.segments.forEach((segment, index) => {
      const left = this.x(segment.start);
      const wide = this.x(segment.duration);
      const moving = segment.kind !== "hold";
      if (segment.moves.length) {
        this.drawLanes(c, segment, top, height);
      } else if (moving) {
        c.fillStyle = "rgba(125, 180, 255, 0.16)";
        c.beginPath();
        c.roundRect(left + 0.5, top, Math.max(wide - 1, 1), height, 4);
        c.fill();
        // A name may run on over the hold that follows.
        const after = show.segments[index + 1];
        const room = after && after.kind === "hold" ? wide + this.x(after.duration) : wide;
        c.font = "11px system-ui, 'DejaVu Sans', sans-serif";
        c.fillStyle = "rgba(233, 237, 246, 0.85)";
        c.fillText(fitting(c, segment.label, room - 9), left + 6, top + height / 2 + 0.5);
      }
    });
  }

  // A strip for each group, with a bar wherever it moves.
  drawLanes(c, segment, top, height) {
    const groups = groupsOf(segment);
    const tall = height / groups.length;
    c.font = `${Math.min(11, Math.max(tall - 1, 5))}px system-ui, 'DejaVu Sans', sans-serif`;
    for (const move of segment.moves) {
      const left = this.x(move.start);
      const wide = this.x(move.duration);
      const above = top + groups.indexOf(move.group) * tall;
      c.fillStyle = `rgba(125, 180, 255, ${move.held ? 0.16 : 0.38})`;
      c.beginPath();
      c.roundRect(left + 0.5, above, Math.max(wide - 1, 1), Math.max(tall - 1, 1), 3);
      c.fill();
      if (tall < 6) continue;
      c.fillStyle = "rgba(233, 237, 246, 0.85)";
      const label = move.held ? move.label : `${move.group}: ${move.label}`;
      c.fillText(fitting(c, label, wide - 9), left + 6, above + tall / 2);
    }
  }

  // Mean colour of the fleet, brightened so that few lights show too.
  drawLight(c) {
    const [top, height] = this.rows.light;
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
    const [top, height] = this.rows.distance;
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
    const [top, height] = this.rows.mesh;
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
