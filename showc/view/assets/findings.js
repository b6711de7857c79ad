// What was found: a list beside the picture, rings in it, marks on the ruler.

function findingRow(finding) {
  const row = document.createElement("li");
  row.className = finding.severity;
  const button = document.createElement("button");
  const head = document.createElement("b");
  head.textContent = [finding.line ? `line ${finding.line}` : "", finding.code].filter(Boolean).join(" · ");
  const text = document.createElement("span");
  text.textContent = finding.message;
  button.append(head, text);
  if (finding.help) {
    const help = document.createElement("em");
    help.textContent = finding.help;
    button.append(help);
  }
  button.disabled = finding.time === null;
  button.onclick = () => {
    play(false);
    seek(finding.time);
    if (finding.drones.length) choose(finding.drones[0]);
  };
  row.append(button);
  return row;
}

function listFindings(findings) {
  show.findings = findings;
  const rows = [];
  let group = "";
  for (const finding of findings) {
    if (finding.group !== group) {
      const head = document.createElement("li");
      head.className = "group";
      head.textContent = group = finding.group;
      rows.push(head);
    }
    rows.push(findingRow(finding));
  }
  $("#findings").replaceChildren(...rows);
}

// Those that can be pointed at; what is proved is only listed.
function markedFindings() {
  const seen = (show.findings ?? []).filter((one) => one.time !== null && (one.severity === "error" || one.severity === "warning"));
  return display.client ? [] : seen;
}

// Rings around the drones of findings while they can be seen.
function findingMarks(onPage) {
  const marks = [];
  for (const finding of markedFindings()) {
    if (Math.abs(finding.time - player.time) > 0.75) continue;
    for (const drone of finding.drones.slice(0, 20)) {
      const place = drone < show.drones && onPage(placeAt(drone, player.time));
      if (place) marks.push([place, finding.severity]);
    }
  }
  return marks;
}

function foldDesk(shut) {
  $("#desk").classList.toggle("shut", shut);
  $(".desk-head").setAttribute("aria-expanded", String(!shut));
  makeRoom();
  if (document.documentElement.dataset.ready === "yes") wake();
}

// What a page that carries everything itself has to say; a page that follows a script
// fills the desk with its own news.
function describeFindings() {
  const count = show.findings.filter((one) => one.severity === "error" || one.severity === "warning").length;
  if (!show.findings.length && !show.unknown.length) return;
  $("#desk").hidden = false;
  $("#desk-title").textContent = count ? `${count} ${count === 1 ? "finding" : "findings"}` : "No findings";
  $("#desk-status").textContent = show.unknown.length ? `Not known: ${show.unknown.join(", ")}` : "";
  listFindings(show.findings);
  const head = document.querySelector("header").getBoundingClientRect().bottom;
  document.documentElement.style.setProperty("--head", `${head + 8}px`);
  foldDesk(innerWidth <= 720 || !count);
}
