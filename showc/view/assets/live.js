// A page that follows a script: it fetches what the server has drawn, again on news.

const live = {};

// The length of the header, the header, the numbers; all zero while nothing was drawn.
async function fetchShow() {
  for (;;) {
    const answer = await fetch("/scene", { cache: "no-store" });
    const bytes = await answer.arrayBuffer();
    if (bytes.byteLength) {
      const length = new DataView(bytes).getUint32(0, true);
      const about = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
      describeScript(about);
      if (about.scene) {
        show = { ...about.scene, findings: about.findings };
        readNumbers(new Uint8Array(bytes, 4 + length));
        return;
      }
    }
    await new Promise((done) => live.wake = done);
  }
}

async function refresh() {
  const former = { duration: show.duration, drones: show.drones, bounds: show.bounds };
  await fetchShow();
  stage.show();
  if (player.chosen >= show.drones) player.chosen = -1;
  player.time = Math.min(player.time, show.duration);
  describe();
  if (JSON.stringify(former.bounds) !== JSON.stringify(show.bounds) && player.view) view(player.view);
  choose(player.chosen);
  draw();
  live.top = show.bounds[1][2];
  document.documentElement.dataset.version = live.version;
}

function describeScript(about) {
  $("#desk-title").textContent = about.script;
  const { stale, solving, solved, legs } = about.status;
  const words = [];
  if (stale) words.push("has errors: the picture is of an earlier version");
  else words.push(solved ? `${solved} of ${legs} legs solved` : "straight lines, not solved");
  if (solving) words.push("solving");
  const count = about.findings.length;
  words.push(count ? `${count} ${count === 1 ? "finding" : "findings"}` : "no findings");
  $("#desk-status").textContent = words.join(" · ");
  $("#desk-status").classList.toggle("stale", stale);
  listFindings(about.findings);
  $("#pictures").replaceChildren(...about.pictures.map(pictureButton));
}

// A formation from the front, or from above if it lies flat.
function pictureButton(picture) {
  const button = document.createElement("button");
  const canvas = document.createElement("canvas");
  const label = document.createElement("span");
  label.textContent = picture.name;
  button.title = `${picture.name}: ${clockText(picture.time)}`;
  button.append(canvas, label);
  button.onclick = () => { play(false); seek(picture.time); };
  const [width, height, room] = [108, 68, 7];
  const density = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = [width * density, height * density];
  const c = canvas.getContext("2d");
  c.scale(density, density);
  const range = (axis) => {
    const values = picture.points.map((point) => point[axis]);
    return [Math.min(...values), Math.max(...values)];
  };
  const deep = range(1);
  const tall = range(2);
  const up = tall[1] - tall[0] < 0.3 * (deep[1] - deep[0]) ? 1 : 2;
  const [left, right] = range(0);
  const [low, high] = up === 1 ? deep : tall;
  const scale = Math.min((width - 2 * room) / Math.max(right - left, 1), (height - 2 * room) / Math.max(high - low, 1));
  const size = Math.max(1, Math.min(2.2, 30 / Math.sqrt(picture.points.length)));
  picture.points.forEach((point, k) => {
    const [r, g, b] = picture.colours[k];
    c.fillStyle = r + g + b > 40 ? `rgb(${r}, ${g}, ${b})` : "#555f73";
    c.beginPath();
    c.arc(width / 2 + (point[0] - (left + right) / 2) * scale, height / 2 - (point[up] - (low + high) / 2) * scale, size, 0, 2 * Math.PI);
    c.fill();
  });
  return button;
}

document.documentElement.classList.add("live");
$("#desk").hidden = false;
foldDesk(innerWidth <= 720);
const news = new EventSource("/news");
news.onmessage = async (event) => {
  live.version = event.data;
  live.wake?.();
  if (document.documentElement.dataset.ready === "yes") await refresh();
};
news.onerror = () => {
  $("#desk-status").textContent = "the server has stopped; start showc preview again";
  $("#desk-status").classList.add("stale");
};
