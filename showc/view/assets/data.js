// The show: the header as JSON, and the numbers unpacked into typed arrays.

let show = JSON.parse(document.getElementById("header").textContent);

function decodeBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

// The numbers of a page that carries them itself.
async function unpack() {
  const element = document.getElementById("data");
  const packed = decodeBase64(element.textContent.trim());
  element.remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  readNumbers(new Uint8Array(await new Response(stream).arrayBuffer()));
}

function readNumbers(raw) {
  const { frames, drones, signalFrames, signals, segments } = show;
  let offset = 0;
  const take = (length) => raw.subarray(offset, (offset += length));

  show.places = readPlaces(take, frames);

  // Colours: differences in time.
  const colours = take(3 * frames * drones);
  show.colours = new Uint8Array(4 * frames * drones).fill(255);
  for (let channel = 0, at = 0; channel < 3; channel++) {
    const value = new Uint8Array(drones);
    for (let frame = 0; frame < frames; frame++) {
      for (let drone = 0; drone < drones; drone++, at++) {
        value[drone] += colours[at];
        show.colours[(frame * drones + drone) * 4 + channel] = value[drone];
      }
    }
  }

  // Speed, tilt, thrust: differences in time, in steps of their range.
  for (const signal of signals) {
    const differences = take(signalFrames * drones);
    signal.values = new Uint8Array(signalFrames * drones);
    const value = new Uint8Array(drones);
    for (let at = 0; at < differences.length; at++) {
      value[at % drones] += differences[at];
      signal.values[at] = value[at % drones];
    }
  }

  // Which of the meshes each drone has on each segment.
  const meshes = take(2 * segments.length * drones);
  show.meshIndex = new Uint16Array(meshes.slice().buffer);

  if (show.second) show.second.places = readPlaces(take, show.second.frames);
}

// Positions: second differences in time, low bytes first, then high bytes.
function readPlaces(take, frames) {
  const { drones } = show;
  const count = 3 * frames * drones;
  const low = take(count);
  const high = take(count);
  const places = new Int16Array(count);
  for (let axis = 0, at = 0; axis < 3; axis++) {
    const value = new Int32Array(drones);
    const rate = new Int32Array(drones);
    for (let frame = 0; frame < frames; frame++) {
      for (let drone = 0; drone < drones; drone++, at++) {
        rate[drone] += low[at] | (high[at] << 8);
        value[drone] += rate[drone];
        places[(frame * drones + drone) * 3 + axis] = value[drone];
      }
    }
  }
  return places;
}

// Frame of a fleet before a time and how far it is to the next one.
function frameAt(time, { frameStep, frames } = show) {
  const position = Math.min(Math.max(time, 0) / frameStep, frames - 1);
  const frame = Math.min(Math.floor(position), Math.max(frames - 2, 0));
  const begin = frame * frameStep;
  const length = Math.min(frameStep, show.duration - begin);
  return [frame, length > 0 ? Math.min(Math.max((time - begin) / length, 0), 1) : 0];
}

// The step that says that a place is not known.
const NOWHERE = -32768;

// Where a drone of a fleet is; null where that is not known.
function placeAt(drone, time, fleet = show) {
  const [frame, share] = frameAt(time, fleet);
  const next = Math.min(frame + 1, fleet.frames - 1);
  const place = [0, 0, 0];
  for (let axis = 0; axis < 3; axis++) {
    const a = fleet.places[(frame * show.drones + drone) * 3 + axis];
    const b = fleet.places[(next * show.drones + drone) * 3 + axis];
    if (a === NOWHERE || b === NOWHERE) return null;
    place[axis] = fleet.origin[axis] + fleet.scale[axis] * (a + (b - a) * share);
  }
  return place;
}

// How far a drone of the second fleet is from the solved one [m]; -1: not known.
function strayed(drone, time) {
  const other = placeAt(drone, time, show.second);
  const own = placeAt(drone, time);
  return other ? Math.hypot(...other.map((value, axis) => value - own[axis])) : -1;
}

function colourAt(drone, time) {
  const [frame] = frameAt(time);
  const at = (frame * show.drones + drone) * 4;
  return [...show.colours.subarray(at, at + 3)];
}

function segmentAt(time) {
  let found = 0;
  show.segments.forEach((segment, index) => {
    if (segment.start <= time + 1e-6) found = index;
  });
  return found;
}

function meshOf(segment, drone) {
  return show.meshes[show.meshIndex[segment * show.drones + drone]];
}

// Distance to the nearest other drone at every signal frame, in the separation's metric.
function nearestDistances(drone) {
  const result = new Float32Array(show.signalFrames);
  const [sx, sy, sz] = show.scale.map((scale, axis) => scale * show.metric[axis]);
  for (let k = 0; k < show.signalFrames; k++) {
    const frame = Math.min(Math.round((k * show.signalStep) / show.frameStep), show.frames - 1);
    const base = frame * show.drones * 3;
    const own = base + drone * 3;
    let least = Infinity;
    for (let at = base; at < base + show.drones * 3; at += 3) {
      if (at === own) continue;
      const dx = (show.places[at] - show.places[own]) * sx;
      const dy = (show.places[at + 1] - show.places[own + 1]) * sy;
      const dz = (show.places[at + 2] - show.places[own + 2]) * sz;
      const square = dx * dx + dy * dy + dz * dz;
      if (square < least) least = square;
    }
    result[k] = Math.sqrt(least);
  }
  return result;
}

function clockText(seconds, digits = 1) {
  // What rounds to nothing has no sign.
  if (Number(seconds.toFixed(digits)) < 0) return `−${clockText(-seconds, digits)}`;
  seconds = Math.max(seconds, 0);
  // Rounded first: 59.96 s are a minute, not 60.0 s.
  const rounded = Number(seconds.toFixed(digits));
  const whole = Math.floor(rounded / 60);
  const rest = (rounded - 60 * whole).toFixed(digits);
  return `${whole}:${rest.padStart(digits ? 3 + digits : 2, "0")}`;
}

function droneName(drone) {
  return show.names?.[drone] || `Drone ${String(drone + 1).padStart(4, "0")}`;
}
