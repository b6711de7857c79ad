// The panel: of the chosen drone, where it is and four plots over the whole show; else
// of the fleet, if it is asked for, its extremes against their limits.

class Panel {
  constructor(element, seek) {
    this.element = element;
    this.seek = seek;
    this.drone = -1;
    this.plots = [];
  }

  choose(drone) {
    this.drone = drone;
    const fleet = drone < 0 && display.fleet;
    this.element.hidden = drone < 0 && !fleet;
    this.element.classList.toggle("of-fleet", fleet);
    this.plots = [];
    if (this.element.hidden) return;
    this.element.querySelector("#panel-title").textContent = fleet ? "Whole fleet" : droneName(drone);
    const holder = this.element.querySelector("#plots");
    holder.replaceChildren();
    this.plots = fleet ? show.bands.map(bandPlot) : this.plotsOf(drone);
    for (const plot of this.plots) this.build(plot, holder);
  }

  plotsOf(drone) {
    const grid = {
      count: show.signalFrames,
      time: (k) => Math.min(k * show.signalStep, show.duration),
      index: (time) => Math.min(Math.round(time / show.signalStep), show.signalFrames - 1),
    };
    const plots = show.signals.map((signal) => ({
      ...signal,
      ...grid,
      at: (k) => (signal.values[k * show.drones + drone] / 255) * signal.range,
    }));
    if (show.drones > 1 && show.signalFrames) {
      const distances = nearestDistances(drone);
      let most = 0;
      for (const value of distances) most = Math.max(most, value);
      plots.push({
        name: "Nearest drone", unit: "m", digits: 2, range: Math.max(1.1 * most, 2 * show.separation),
        limits: show.separation === null ? [] : [show.separation], least: true, ...grid, at: (k) => distances[k],
      });
    }
    return plots;
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
    if (plot.limitAt) {
      c.beginPath();
      for (let k = 0; k < plot.count; k++) {
        const limit = plot.limitAt(k);
        if (limit === null || limit > plot.range) { c.stroke(); c.beginPath(); }
        else c.lineTo(x(plot.time(k)), y(limit));
      }
      c.stroke();
    }
    c.setLineDash([]);
    c.lineWidth = 1.4;
    c.lineJoin = "round";
    // A piece at a time in the colour of the value that it leads to.
    let red = null;
    c.beginPath();
    for (let k = 0; k < plot.count; k++) {
      const wrong = brokenAt(plot, k);
      c.lineTo(x(plot.time(k)), y(plot.at(k)));
      if (wrong !== red || k === plot.count - 1) {
        c.strokeStyle = red ? "#ff6b7a" : "#7db4ff";
        c.stroke();
        c.beginPath();
        c.moveTo(x(plot.time(k)), y(plot.at(k)));
        red = wrong;
      }
    }
    box.classList.toggle("broken", plot.count > 0 && Array.from({ length: plot.count }, (_, k) => k).some((k) => brokenAt(plot, k)));
  }

  move(time) {
    for (const plot of this.plots) {
      const k = plot.index(time);
      plot.value.textContent = `${plot.at(k).toFixed(plot.digits)} ${plot.unit}`;
      plot.cursor.style.transform = `translateX(${(time / show.duration) * plot.width}px)`;
    }
    if (this.drone < 0) return;
    const [x, y, z] = placeAt(this.drone, time).map((value) => value.toFixed(2));
    this.element.querySelector("#panel-place").textContent = `x ${x}   y ${y}   z ${z} m`;
    const [r, g, b] = colourAt(this.drone, time);
    this.element.querySelector("#swatch").style.background = `rgb(${r}, ${g}, ${b})`;
  }
}

// By how much a value may be beyond its limit by the rounding of what the page carries.
const ROUNDING = 0.006;

function brokenAt(plot, k) {
  const limit = plot.limitAt ? plot.limitAt(k) : plot.limits[0];
  if (limit === undefined || limit === null) return false;
  const excess = plot.least ? limit - plot.at(k) : plot.at(k) - limit;
  return excess > ROUNDING * Math.max(limit, plot.limitAt ? 0 : plot.range);
}

function bandPlot(band) {
  const { times } = band;
  const most = Math.max(...band.values, 1e-3);
  const limits = band.limits.filter((one) => one !== null && one < 2.5 * most);
  return {
    ...band,
    limits: [],
    range: 1.08 * Math.max(most, ...limits),
    count: times.length,
    time: (k) => times[k],
    index: (time) => Math.max(times.findLastIndex((one) => one <= time + 1e-6), 0),
    at: (k) => band.values[k],
    limitAt: (k) => band.limits[k],
  };
}
