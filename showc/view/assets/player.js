// Plays the show: time, mouse, keys, and the marks over the picture.

const $ = (selector) => document.querySelector(selector);
const query = new URLSearchParams(location.search);
const player = { time: 0, speed: 1, playing: false, chosen: -1, pointed: -1, farthest: -1, last: 0 };
let stage, timeline, panel;
// What is shown beside the fleet; the menu turns each on and off.
const display = { names: true, numbers: false, fleet: false, second: false, tubes: false, loop: false, client: false };
const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
window.__frames = 0;

function seek(time) {
  player.time = Math.min(Math.max(time, 0), show.duration);
  wake();
}

function play(on) {
  if (on && player.time >= show.duration) player.time = 0;
  player.playing = on;
  player.last = performance.now();
  followSound();
  $("#play-shape").setAttribute("d", on ? "M3 1.5h3.6v13H3zM9.4 1.5H13v13H9.4z" : "M3 1.5v13L14 8z");
  wake();
}

function choose(drone) {
  player.chosen = drone;
  camera.follow = camera.follow && drone >= 0;
  panel.choose(drone);
  stage.showTrail(drone);
  timeline.draw(drone);
  wake();
}

function chapterStep(direction) {
  const starts = [...new Set(show.segments.filter((s) => s.kind !== "hold").map((s) => s.start)), show.duration];
  seek(direction > 0
    ? starts.find((start) => start > player.time + 0.05) ?? show.duration
    : starts.findLast((start) => start < player.time - 0.6) ?? 0);
}

// A short text over the picture: what it shows, or what went wrong.
function caption(text) {
  if ($("#caption").textContent !== text) $("#caption").textContent = text;
}

function toggle(name, on = !display[name]) {
  display[name] = on;
  document.documentElement.classList.toggle(name, on);
  document.querySelector(`#menu [data-toggle="${name}"]`).setAttribute("aria-checked", String(on));
  if (name === "client" && on) choose(-1);
  panel.choose(player.chosen);
  timeline.draw();
  wake();
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.documentElement.requestFullscreen?.().catch(() => {});
}

// Numbers beside the drones, on a layer that is only there when they are.
function drawNumbers(matrix) {
  const canvas = $("#numbers");
  canvas.hidden = !display.numbers;
  if (canvas.hidden) return;
  const [width, height] = [innerWidth, innerHeight];
  const density = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = [width * density, height * density];
  const c = canvas.getContext("2d");
  c.scale(density, density);
  c.font = "11px system-ui, 'DejaVu Sans', sans-serif";
  c.fillStyle = "rgba(233, 237, 246, 0.9)";
  const taken = new Set();
  for (let drone = 0; drone < show.drones; drone++) {
    const [x, y, depth] = project(matrix, placeAt(drone, player.time), width, height);
    // One number for each patch of the page: more could not be read.
    const patch = `${Math.round(x / 24)},${Math.round(y / 12)}`;
    if (depth <= 0 || x < 0 || x > width || y < 0 || y > height || taken.has(patch)) continue;
    taken.add(patch);
    c.fillText(String(drone + 1), x + 7, y - 5);
  }
}

// The picture stands beside the desk, and not behind it.
function makeRoom() {
  const desk = $("#desk");
  const open = innerWidth > 720 && !desk.classList.contains("shut");
  camera.aside = open ? desk.getBoundingClientRect().right / innerWidth : 0;
}

function view(name) {
  player.view = name;
  makeRoom();
  lookAt(name, innerWidth, innerHeight);
  document.querySelectorAll("nav button[data-view]").forEach((button) => button.classList.toggle("on", button.dataset.view === name));
  wake();
}

function moveTag(tag, place, text) {
  tag.hidden = !place;
  if (!place) return;
  if (text !== undefined) tag.textContent = text;
  tag.style.transform = `translate(${place[0].toFixed(1)}px, ${place[1].toFixed(1)}px)`;
}

// Ring around the chosen drone, line between the nearest pair, N at the arrow.
function drawMarks(matrix) {
  const [width, height] = [innerWidth, innerHeight];
  const onPage = (point) => {
    const place = project(matrix, point, width, height);
    return place[2] > 0 ? place : null;
  };
  const ring = player.chosen >= 0 ? onPage(placeAt(player.chosen, player.time)) : null;
  $("#ring").style.display = ring ? "" : "none";
  if (ring) {
    $("#ring").setAttribute("cx", ring[0]);
    $("#ring").setAttribute("cy", ring[1]);
  }
  moveTag($("#ring-label"), ring && [ring[0] + 17, ring[1] - 24], ring ? String(player.chosen + 1) : "");
  const near = display.client ? undefined : show.encounters
    .filter((e) => Math.abs(e.time - player.time) < (e.tightest ? 1 : 0.4))
    .sort((a, b) => Math.abs(a.time - player.time) - Math.abs(b.time - player.time))[0];
  const ends = near ? [near.a, near.b].map((drone) => onPage(placeAt(drone, player.time))) : [];
  const shown = ends.length === 2 && ends.every(Boolean);
  $("#pair-line").style.display = shown ? "" : "none";
  if (shown) {
    const [a, b] = ends;
    for (const [name, value] of Object.entries({ x1: a[0], y1: a[1], x2: b[0], y2: b[1] })) $("#pair-line").setAttribute(name, value);
    const wrong = near.distance < show.separation;
    $("#pair-line").style.stroke = wrong ? "" : "#ffb454";
    $("#pair-label").classList.toggle("danger", wrong);
  }
  const found = findingMarks(onPage);
  $("#finding-rings").replaceChildren(...found.map(([[x, y], kind]) => {
    const circle = $("#ring").cloneNode();
    circle.removeAttribute("style");
    for (const [name, value] of Object.entries({ id: "", cx: x, cy: y, r: 11, class: kind })) circle.setAttribute(name, value);
    return circle;
  }));
  const apart = drawStrayed(onPage);
  // An empty layer over the whole page would still cost software renderers its area.
  $("#marks").style.display = ring || shown || apart || found.length ? "" : "none";
  moveTag($("#pair-label"), shown && [(ends[0][0] + ends[1][0]) / 2 + 12, (ends[0][1] + ends[1][1]) / 2 + 12],
    shown ? `${near.distance.toFixed(2)} m · ${near.a + 1} and ${near.b + 1}` : "");
  const tip = display.client || show.heading === null ? null : onPage(northArrow()[0]);
  moveTag($("#north"), tip && tip[1] < height - 160 && [tip[0] - 10, tip[1] - 20]);
}

function secondShown() {
  return Boolean(show.second) && display.second && !display.client;
}

// Line from the drone under the pointer, else the chosen one, to where it is in the
// second fleet, and how far it is; of the whole fleet the greatest distance.
function drawStrayed(onPage) {
  $("#farthest").hidden = !secondShown();
  const drone = player.pointed >= 0 ? player.pointed : player.chosen;
  const apart = secondShown() && drone >= 0 ? strayed(drone, player.time) : -1;
  const ends = apart < 0 ? [] : [placeAt(drone, player.time), placeAt(drone, player.time, show.second)].map(onPage);
  const shown = ends.length === 2 && ends.every(Boolean);
  $("#second-line").style.display = shown ? "" : "none";
  if (shown) {
    const [a, b] = ends;
    for (const [name, value] of Object.entries({ x1: a[0], y1: a[1], x2: b[0], y2: b[1] })) $("#second-line").setAttribute(name, value);
  }
  moveTag($("#second-label"), shown && [ends[0][0] + 17, ends[0][1] - 24], shown ? `${drone + 1}: ${apart.toFixed(2)} m` : "");
  if (shown && drone === player.chosen) $("#ring-label").hidden = true;
  if (!secondShown()) return false;
  let most = -1;
  for (let k = 0; k < show.drones; k++) {
    const away = strayed(k, player.time);
    if (away > most) [player.farthest, most] = [k, away];
  }
  $("#farthest").textContent = `◯ ${show.second.name}: ` + (most < 0 ? "no record now" : `up to ${most.toFixed(2)} m, drone ${player.farthest + 1}`);
  $("#farthest").disabled = most < 0;
  return shown;
}

function follow() {
  if (!camera.follow || player.chosen < 0) return;
  const place = placeAt(player.chosen, player.time);
  const haste = calm ? 1 : 0.2;
  camera.target = camera.target.map((value, axis) => value + haste * (place[axis] - value));
}

function draw() {
  follow();
  const matrix = stage.draw(player.time);
  drawMarks(matrix);
  drawNumbers(matrix);
  const segment = show.segments[segmentAt(player.time)];
  caption(display.names && segment.picture && !segment.picture.startsWith("above ") ? segment.picture : "");
  timeline.move(player.time);
  panel.move(player.time);
  $("#clock").textContent = clockText(player.time);
  $("#chapter").textContent = movingAt(segment, player.time);
  followSound();
  window.__frames++;
}

// Frames are drawn while something moves, and once after each change.
let pending = false;
function wake() {
  if (pending || !stage) return;
  pending = true;
  requestAnimationFrame(tick);
}

function tick(now) {
  pending = false;
  if (player.playing) {
    player.time += (player.speed * Math.min(now - player.last, 250)) / 1000;
    if (player.time >= show.duration) {
      player.time = display.loop ? 0 : show.duration;
      if (!display.loop) play(false);
    }
  }
  player.last = now;
  draw();
  if (player.playing || camera.follow) wake();
}

function listenToMouse(canvas) {
  const pointers = new Map();
  let moved = 0;
  let spread = 0;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.classList.add("grabbing");
    moved = 0;
    spread = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return point(event.clientX, event.clientY);
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    moved += Math.abs(dx) + Math.abs(dy);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (pointers.size === 2) {
      const [a, b] = [...pointers.values()];
      const wide = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (spread) camera.distance *= spread / wide;
      spread = wide;
    } else if (event.shiftKey || event.buttons & 2) {
      const { right, up } = cameraAxes();
      const step = (2 * camera.distance * Math.tan(FIELD_OF_VIEW / 2)) / innerHeight;
      camera.follow = false;
      camera.target = camera.target.map((value, axis) => value - step * (dx * right[axis] - dy * up[axis]));
    } else {
      camera.azimuth -= dx * 0.006;
      camera.elevation = Math.min(Math.max(camera.elevation + dy * 0.006, -0.2), Math.PI / 2 - 1e-3);
    }
    wake();
  });
  const release = (event) => {
    if (pointers.has(event.pointerId) && moved < 5 && event.type === "pointerup") choose(droneAt(event.clientX, event.clientY));
    pointers.delete(event.pointerId);
    canvas.classList.remove("grabbing");
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => { player.pointed = -1; wake(); });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.distance = Math.min(Math.max(camera.distance * Math.exp(event.deltaY * 0.0012), 1), 5000);
    wake();
  }, { passive: false });
}

// The drone that is drawn at a point of the page, or -1.
function droneAt(x, y) {
  const matrix = viewProjection(innerWidth, innerHeight);
  let [best, least] = [-1, 18];
  for (let drone = 0; drone < show.drones; drone++) {
    const [px, py, depth] = project(matrix, placeAt(drone, player.time), innerWidth, innerHeight);
    const away = Math.hypot(px - x, py - y);
    if (depth > 0 && away < least) [best, least] = [drone, away];
  }
  return best;
}

function point(x, y) {
  const found = secondShown() ? droneAt(x, y) : -1;
  if (found === player.pointed) return;
  player.pointed = found;
  wake();
}

function setSpeed(step) {
  const select = $("#speed");
  select.selectedIndex = Math.min(Math.max(select.selectedIndex + step, 0), select.options.length - 1);
  player.speed = Number(select.value);
}

function stepDrone(step) {
  choose((player.chosen + step + show.drones) % show.drones);
}

function toTightest() {
  const tightest = show.encounters.find((encounter) => encounter.tightest);
  if (!tightest) return;
  play(false);
  seek(tightest.time);
}

const KEYS = {
  " ": () => play(!player.playing),
  ArrowLeft: (event) => seek(player.time - (event.shiftKey ? 5 : 1)),
  ArrowRight: (event) => seek(player.time + (event.shiftKey ? 5 : 1)),
  ",": () => seek(player.time - show.frameStep),
  ".": () => seek(player.time + show.frameStep),
  "[": () => chapterStep(-1),
  "]": () => chapterStep(1),
  "+": () => setSpeed(1),
  "=": () => setSpeed(1),
  "-": () => setSpeed(-1),
  Home: () => seek(0),
  End: () => seek(show.duration),
  e: toTightest,
  n: (event) => stepDrone(event.shiftKey ? -1 : 1),
  c: () => { camera.follow = player.chosen >= 0 && !camera.follow; wake(); },
  f: () => view("front"),
  r: () => view("orbit"),
  t: () => view("top"),
  l: () => toggle("loop"),
  "#": () => toggle("numbers"),
  g: () => toggle("fleet"),
  m: () => show.second && toggle("second"),
  w: () => show.tubes && toggle("tubes"),
  p: () => toggle("client"),
  x: fullScreen,
  "?": () => ($("#help").hidden = !$("#help").hidden),
  Escape: () => {
    if (!$("#help").hidden) $("#help").hidden = true;
    else if (!$("#menu").hidden) $("#menu-button").click();
    else if (player.chosen >= 0) choose(-1);
    else if (display.client) toggle("client", false);
  },
};

function listen() {
  listenToMouse($("#stage"));
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.key === " " && event.target.tagName === "BUTTON") return;
    const action = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action(event);
  });
  addEventListener("resize", () => { makeRoom(); timeline.draw(); wake(); });
  $(".desk-head").onclick = () => foldDesk(!$("#desk").classList.contains("shut"));
  $("#play").onclick = () => play(!player.playing);
  $("#previous").onclick = () => chapterStep(-1);
  $("#next").onclick = () => chapterStep(1);
  $("#speed").onchange = () => setSpeed(0);
  $("#tightest").onclick = toTightest;
  $("#farthest").onclick = () => choose(player.farthest);
  $("#menu").onclick = (event) => {
    const name = event.target.closest("[data-toggle]")?.dataset.toggle;
    if (name) toggle(name);
  };
  $("#menu-button").onclick = () => {
    $("#menu").hidden = !$("#menu").hidden;
    $("#menu-button").setAttribute("aria-expanded", String(!$("#menu").hidden));
  };
  $("#full").onclick = fullScreen;
  $("#leave-client").onclick = () => toggle("client", false);
  $("#sound-file").onchange = async (event) => {
    const [file] = event.target.files;
    if (file) await loadSound(await file.arrayBuffer(), file.type);
  };
  $("#help-button").onclick = KEYS["?"];
  $("#panel-close").onclick = () => { if (player.chosen < 0) toggle("fleet", false); else choose(-1); };
  $("#panel-previous").onclick = () => stepDrone(-1);
  $("#panel-next").onclick = () => stepDrone(1);
  document.querySelectorAll("nav button[data-view]").forEach((button) => (button.onclick = () => view(button.dataset.view)));
}

function describe() {
  document.title = show.name;
  $("#title").textContent = show.name;
  $("#subtitle").textContent = `${show.drones} ${show.drones === 1 ? "drone" : "drones"} · ${clockText(show.duration)} · ${show.chapters} ${show.chapters === 1 ? "move" : "moves"}`;
  $("#length").textContent = `/ ${clockText(show.duration)}`;
  const tightest = show.encounters.find((encounter) => encounter.tightest);
  if (tightest) {
    $("#tightest").hidden = false;
    $("#tightest").textContent = `◆ closest pair ${tightest.distance.toFixed(2)} m at ${clockText(tightest.time)}`;
  }
  const mesh = show.meshes.length > 1 ? " · solver mesh" : "";
  $("#legend").textContent = `Chapters · average colour · closest pair of each move (◆ of the show)${mesh} · time, cues and findings (▲)`;
  $("#menu [data-toggle=second]").hidden = !show.second;
  if (show.second) {
    const { name, frameStep } = show.second;
    // Of great fleets a page has fewer frames.
    const sparse = frameStep > 1.5 * show.frameStep ? `, every ${frameStep.toFixed(2)} s` : "";
    $("#menu [data-toggle=second] span").textContent = name + sparse;
  }
  show.tubes = show.segments.some((segment) => segment.tube);
  $("#menu [data-toggle=tubes]").hidden = !show.tubes;
  $("#menu [data-toggle=fleet]").hidden = !show.bands.length;
  $("#tightest").classList.toggle("plain", Boolean(tightest) && tightest.distance >= show.separation);
}

// ?t=41&play=0&drone=7&view=top, or a camera: &az=20&el=10&dist=60&target=0,0,10 (degrees, metres)
function obeyAddress() {
  view(query.get("view") ?? "orbit");
  const degrees = Math.PI / 180;
  if (query.has("az")) camera.azimuth = Number(query.get("az")) * degrees;
  if (query.has("el")) camera.elevation = Number(query.get("el")) * degrees;
  if (query.has("dist")) camera.distance = Number(query.get("dist"));
  if (query.has("target")) camera.target = query.get("target").split(",").map(Number);
  if (query.has("speed")) {
    $("#speed").value = query.get("speed");
    setSpeed(0);
  }
  if (show.second?.shown) toggle("second", true);
  if (query.has("drone")) choose(Math.min(Math.max(Number(query.get("drone")) - 1, -1), show.drones - 1));
  for (const name of Object.keys(display)) if (query.has(name)) toggle(name, query.get(name) !== "0");
  seek(Number(query.get("t") ?? 0));
  // Pages do not move by themselves where that is not wanted.
  play(query.has("play") ? query.get("play") !== "0" : !calm);
}

async function start() {
  const begin = performance.now();
  try {
    if (!show.frames) await fetchShow();
    else await unpack();
    stage = new Stage($("#stage"));
    timeline = new Timeline($("#timeline"), seek);
    panel = new Panel($("#panel"), seek);
    describe();
    if (!document.documentElement.classList.contains("live")) describeFindings();
    listen();
    timeline.draw();
    obeyAddress();
    draw();
    loadOwnSound();
  } catch (error) {
    $("#failure").hidden = false;
    $("#failure").textContent = `This browser cannot draw the show. ${error.message}`;
    throw error;
  }
  window.__load_ms = performance.now() - begin;
  document.documentElement.dataset.ready = "yes";
}

start();
