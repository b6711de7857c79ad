// The panel of the chosen drone: where it is, and four plots over the whole show.

class Panel {
  constructor(element, seek) {
    this.element = element;
    this.seek = seek;
    this.drone = -1;
    this.plots = [];
  }

  choose(drone) {
    this.drone = drone;
    this.element.hidden = drone < 0;
    if (drone < 0) return;
    this.element.querySelector("#panel-title").textContent = droneName(drone);
    const holder = this.element.querySelector("#plots");
    holder.replaceChildren();
    this.plots = show.signals.map((signal) => ({
      ...signal,
      at: (k) => (signal.values[k * show.drones + drone] / 255) * signal.range,
    }));
    if (show.drones > 1) {
      const distances = nearestDistances(drone);
      let most = 0;
      for (const value of distances) most = Math.max(most, value);
      this.plots.push({
        name: "Nearest drone", unit: "m", digits: 2, range: Math.max(1.1 * most, 2 * show.separation),
        limits: [show.separation], at: (k) => distances[k],
      });
    }
    for (const plot of this.plots) this.build(plot, holder);
  }

  build(plot, holder) {
    const box = document.createElement("div");
    box.className = "plot";
    box.innerHTML = "<h3><span></span><b></b></h3><canvas></canvas><i></i>";
    box.querySelector("span").textContent = plot.name;
    holder.append(box);
    plot.value = box.querySelector("b");
    plot.cursor = box.querySelector("i");
    const canvas = box.querySelector("canvas");
    const seek = (event) => {
      const frame = canvas.getBoundingClientRect();
      const share = Math.min(Math.max((event.clientX - frame.left) / frame.width, 0), 1);
      this.seek(share * show.duration);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      seek(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons & 1 && seek(event));
    const density = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    [canvas.width, canvas.height] = [width * density, height * density];
    plot.width = width;
    const c = canvas.getContext("2d");
    c.scale(density, density);
    const x = (time) => (time / show.duration) * width;
    const y = (value) => height - 3 - (value / plot.range) * (height - 6);
    c.fillStyle = "rgba(255, 255, 255, 0.035)";
    c.fillRect(0, 0, width, height);
    c.fillStyle = "rgba(125, 180, 255, 0.07)";
    for (const segment of show.segments)
      if (segment.kind !== "hold") c.fillRect(x(segment.start), 0, x(segment.duration), height);
    c.setLineDash([4, 3]);
    c.strokeStyle = "rgba(255, 180, 84, 0.65)";
    for (const limit of plot.limits) {
      if (limit > plot.range) continue;
      c.beginPath();
      c.moveTo(0, y(limit));
      c.lineTo(width, y(limit));
      c.stroke();
    }
    c.setLineDash([]);
    c.beginPath();
    for (let k = 0; k < show.signalFrames; k++)
      c.lineTo(x(Math.min(k * show.signalStep, show.duration)), y(plot.at(k)));
    c.strokeStyle = "#7db4ff";
    c.lineWidth = 1.4;
    c.lineJoin = "round";
    c.stroke();
  }

  move(time) {
    if (this.drone < 0) return;
    const k = Math.min(Math.round(time / show.signalStep), show.signalFrames - 1);
    for (const plot of this.plots) {
      plot.value.textContent = `${plot.at(k).toFixed(plot.digits)} ${plot.unit}`;
      plot.cursor.style.transform = `translateX(${(time / show.duration) * plot.width}px)`;
    }
    const [x, y, z] = placeAt(this.drone, time).map((value) => value.toFixed(2));
    this.element.querySelector("#panel-place").textContent = `x ${x}   y ${y}   z ${z} m`;
    const [r, g, b] = colourAt(this.drone, time);
    this.element.querySelector("#swatch").style.background = `rgb(${r}, ${g}, ${b})`;
  }
}
