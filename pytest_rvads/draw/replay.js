const run = JSON.parse(document.getElementById("data").textContent);
const last = run.steps - 1, ink = ["#888", "#1fa34a", "#e0a800", "#d11f1f"], letters = "NGYR";
const places = {"-1": "absent", 0: "approach", 1: "entrance", 2: "junction", 3: "exit", 4: "gone"}, colours = ["none", "green", "yellow", "red"];
const get = id => document.getElementById(id);
const bodies = document.querySelectorAll(".vehicle"), trails = document.querySelectorAll(".trail");
const driven = run.agents.map((name, i) => [name, run.zones[i].map(([tick, zone]) => [tick, places[zone]])]);
const lamps = run.lights.map((changes, e) => ["light " + run.entrances[e], changes.map(([tick, colour]) => [tick, colours[colour]])])
  .filter(([, changes]) => changes.some(([, word]) => word !== "none"));
// Among dozens of vehicles, those that it is about come first.
const about = run.trail ? driven.filter(([name]) => run.responsible.includes(name)) : [];
const rows = run.trail ? [...about, ...run.tracks, ...lamps, ...driven.filter(row => !about.includes(row))]
  : [...driven, ...lamps, ...run.tracks];
let now = 0, timer = null, cursors = [], told = [];
function at(changes, tick) { return changes.findLast(([since]) => since <= tick)[1]; }
function clock(tick) { return run.start + tick * run.dt; }
function motion(tick, i) {
  const k = Math.min(Math.floor(tick / run.every), run.motion.length - 1), share = tick / run.every - k;
  const one = run.motion[k][i], two = (run.motion[k + 1] || run.motion[k])[i];
  if (!one || !two) return one || two; // absent on one side, or on both
  return one.map((value, j) => value + share * (two[j] - value));
}
function show(index) {
  now = Math.max(0, Math.min(last, Math.round(index)));
  const time = clock(now), end = Math.floor(now / run.every) + 1, first = run.trail ? Math.max(0, end - run.trail) : 0;
  run.agents.forEach((name, i) => {
    const zone = at(run.zones[i], now), place = zone === -1 ? null : motion(now, i), line = get("states").tBodies[0].rows[i];
    const here = place && zone !== 4;
    bodies[i].style.display = here ? "" : "none";
    trails[i].style.display = here ? "" : "none";
    line.hidden = !place;
    if (!place) return;
    const [x, y, heading, station, speed] = place;
    const points = run.motion.slice(first, end).map(m => m[i]).filter(Boolean).map(m => `${m[0]},${-m[1]}`);
    trails[i].setAttribute("points", points.join(" ") + ` ${x},${-y}`);
    bodies[i].setAttribute("transform", `translate(${x} ${-y}) rotate(${-heading * 180 / Math.PI})`);
    const written = bodies[i].querySelector("text"), along = written.classList.contains("along");
    const turned = !along ? heading * 180 / Math.PI : Math.cos(heading) < 0 ? 180 : 0;
    written.setAttribute("transform", `translate(${-run.lengths[i] * (along ? 0.58 : 0.5)} 0) rotate(${turned})`);
    const cells = line.cells;
    cells[1].textContent = places[zone];
    cells[2].textContent = `${station < 0 ? "" : "+"}${station.toFixed(2)} m`;
    cells[3].textContent = `${speed.toFixed(2)} m/s`;
  });
  document.querySelectorAll(".lamp").forEach(lamp => {
    const colour = at(run.lights[+lamp.dataset.entrance], now);
    lamp.querySelector("circle").setAttribute("fill", ink[colour]);
    lamp.querySelector("text").textContent = letters[colour];
  });
  cursors.forEach(cursor => { cursor.style.left = 100 * now / Math.max(last, 1) + "%"; });
  told.forEach(([row, label, changes]) => { row.firstChild.textContent = `${label}: ${at(changes, now)}`; });
  get("scrub").value = now;
  get("clock").value = time.toFixed(2) + " s";
  const list = get("events"), coming = [...list.children].filter(b => !b.classList.toggle("past", +b.dataset.time < time - 1e-9))[0];
  list.scrollTop = (coming ? coming.offsetTop - list.offsetTop : list.scrollHeight) - list.clientHeight / 2;
}
function strip([label, changes]) {
  const row = make("div", get("strips"), "", "row"), name = make("span", row, "", "faint"), bar = make("div", row, "", "strip");
  name.title = label;
  changes.forEach(([tick, word], k) => {
    const end = k + 1 < changes.length ? changes[k + 1][0] : last, part = make("i", bar, word, word);
    part.style.left = 100 * tick / Math.max(last, 1) + "%";
    part.style.width = 100 * (end - tick) / Math.max(last, 1) + "%";
    part.title = `${label}: ${word} from ${clock(tick).toFixed(2)} s`;
  });
  run.marked.forEach(time => { make("u", bar, "", "").style.left = 100 * (time - run.start) / run.dt / Math.max(last, 1) + "%"; });
  cursors.push(make("b", bar, "", ""));
  told.push([row, label, changes]);
  bar.onclick = event => {
    const box = bar.getBoundingClientRect();
    pause(); show((event.clientX - box.left) / box.width * last);
  };
}
function pause() { cancelAnimationFrame(timer); timer = null; get("play").textContent = "play"; }
function play() {
  if (now === last) show(0);
  let before = performance.now(), exact = now;
  get("play").textContent = "pause";
  const step = stamp => {
    exact += (stamp - before) / 1000 * get("speed").value / run.dt;
    before = stamp;
    show(exact);
    if (exact >= last) pause(); else timer = requestAnimationFrame(step);
  };
  timer = requestAnimationFrame(step);
}
function go(time) { pause(); show((time - run.start) / run.dt); }
function link() { const found = location.hash.match(/t=(-?\d+(\.\d*)?)/); if (found) go(+found[1]); }
run.agents.forEach((name, i) => {
  const row = get("states").tBodies[0].insertRow(), kind = run.kinds[i] === "car" ? "" : run.kinds[i] + " ";
  for (const text of [kind + name + (run.responsible.includes(name) ? " (responsible)" : ""), "", "", ""]) row.insertCell().textContent = text;
});
run.events.forEach(([time, text, marked]) => {
  const button = make("button", get("events"), `${time.toFixed(2)} s  ${text}`, marked ? "told" : "");
  button.dataset.time = time;
  button.onclick = () => { history.replaceState(null, "", "#t=" + time.toFixed(2)); go(time); };
});
rows.forEach(strip);
get("scrub").max = last;
get("scrub").oninput = event => { pause(); show(+event.target.value); };
get("play").onclick = () => timer === null ? play() : pause();
const root = document.documentElement.dataset;
root.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
get("theme").onclick = () => { root.theme = root.theme === "dark" ? "light" : "dark"; };
addEventListener("hashchange", link);
addEventListener("keydown", event => {
  if (event.target.tagName === "SELECT") return;
  const jump = event.shiftKey ? 1 / run.dt : 1;
  const act = {" ": () => timer === null ? play() : pause(), ArrowRight: () => { pause(); show(now + jump); },
    ArrowLeft: () => { pause(); show(now - jump); }, Home: () => go(run.start), End: () => { pause(); show(last); }}[event.key];
  if (act) { event.preventDefault(); act(); }
});
go(run.opened);
link();
