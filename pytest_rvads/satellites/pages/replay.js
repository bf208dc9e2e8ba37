const run = JSON.parse(document.getElementById("data").textContent);
const last = run.steps - 1, ink = ["#888", "#1fa34a", "#e0a800", "#d11f1f"], letters = "NGYR";
const places = {"-1": "absent", 0: "approach", 1: "entrance", 2: "junction", 3: "exit", 4: "gone"}, colours = ["none", "green", "yellow", "red"];
const onFoot = {"-1": "absent", 0: "sidewalk", 1: "kerb", 2: "crosswalk", 3: "sidewalk", 4: "gone"};
const words = run.kinds.map(kind => kind === "pedestrian" ? onFoot : places);
const stage = get("stage"), scene = stage.querySelector("svg");
const bodies = document.querySelectorAll(".vehicle"), trails = document.querySelectorAll(".trail"), ghosts = document.querySelectorAll(".ghost");
// Bodies that overlap by their recorded places and sizes may not have touched.
const impacts = run.watched ? run.impacts : [];
const struck = run.agents.map((name, i) => impacts.find(([, who]) => who.includes(i))?.[0] ?? Infinity);
const driven = run.agents.map((name, i) => [name, run.zones[i].map(([tick, zone]) => [tick, words[i][zone]]), struck[i]]);
const over = run.trail || !impacts.length ? Infinity : impacts[0][0]; // recorded traffic drives on after an impact
const lamps = run.lights.map((changes, e) => ["light " + run.entrances[e], changes.map(([tick, colour]) => [tick, colours[colour]])])
  .filter(([, changes], e) => run.entrances[e] && changes.some(([, word]) => word !== "none"));
// Among dozens of recorded vehicles, the responsible vehicles come first.
const about = run.trail ? driven.filter(([name]) => run.responsible.includes(name)) : [];
const rows = run.trail ? [...about, ...run.tracks, ...lamps, ...driven.filter(row => !about.includes(row))]
  : [...driven, ...lamps, ...run.tracks];
const twins = run.ghost ? run.ghost.agents.map(name => run.agents.indexOf(name)) : [];
let now = 0, timer = null, cursors = [], told = [], followed = -1;
function at(changes, tick) { return changes.findLast(([since]) => since <= tick)[1]; }
function clock(tick) { return run.start + tick * run.dt; }
function motion(stored, exact, i) {
  const k = Math.min(Math.floor(exact), stored.length - 1), share = exact - k;
  const one = stored[k][i], two = (stored[k + 1] || stored[k])[i];
  if (!one || !two) return one || two; // absent at one of the two stored states, or at both
  return one.map((value, j) => value + share * (two[j] - value));
}
function pose(x, y, heading) { return `translate(${x} ${-y}) rotate(${-heading * 180 / Math.PI})`; }
function show(index) {
  now = Math.max(0, Math.min(last, Math.round(index)));
  const time = clock(now), end = Math.floor(now / run.every) + 1, first = run.trail ? Math.max(0, end - run.trail) : 0;
  run.agents.forEach((name, i) => {
    const zone = at(run.zones[i], now), place = zone === -1 ? null : motion(run.motion, now / run.every, i);
    const line = get("states").tBodies[0].rows[i], here = place && zone !== 4;
    bodies[i].style.display = here ? "" : "none";
    trails[i].style.display = here ? "" : "none";
    line.hidden = !place;
    if (!place) return;
    const [x, y, heading, station, speed] = place;
    const points = run.motion.slice(first, end).map(m => m[i]).filter(Boolean).map(m => `${m[0]},${-m[1]}`);
    trails[i].setAttribute("points", points.join(" ") + ` ${x},${-y}`);
    bodies[i].setAttribute("transform", pose(x, y, heading));
    const written = bodies[i].querySelector("text"), along = written.classList.contains("along");
    const turned = !along ? heading * 180 / Math.PI : Math.cos(heading) < 0 ? 180 : 0;
    written.setAttribute("transform", `translate(${-run.lengths[i] * (along ? 0.58 : 0.5)} 0) rotate(${turned})`);
    const cells = line.cells;
    cells[1].textContent = words[i][zone];
    cells[2].textContent = `${station < 0 ? "" : "+"}${station.toFixed(2)} m`;
    cells[3].textContent = `${speed.toFixed(2)} m/s`;
    cells[3].className = now > struck[i] ? "after" : "";
    if (i === followed && here) look(x - run.lengths[i] / 2 * Math.cos(heading), -y + run.lengths[i] / 2 * Math.sin(heading));
  });
  ghosts.forEach((body, i) => {
    const {motion: stored, dt, every, start} = run.ghost, exact = (time - start) / dt / every;
    const place = exact > stored.length - 1 + 1e-6 || exact < 0 ? null : motion(stored, exact, i);
    const twin = place && twins[i] >= 0 && at(run.zones[twins[i]], now) >= 0 ? motion(run.motion, now / run.every, twins[i]) : null;
    const apart = place && !(twin && Math.hypot(twin[0] - place[0], twin[1] - place[1]) < 0.05);
    body.style.display = apart ? "" : "none"; // a ghost at the place of its vehicle is not shown
    if (apart) body.setAttribute("transform", pose(...place));
  });
  document.querySelectorAll(".lamp").forEach(lamp => {
    const colour = at(run.lights[+lamp.dataset.entrance], now);
    lamp.querySelector("circle").setAttribute("fill", ink[colour]);
    lamp.querySelector("text").textContent = letters[colour];
  });
  const hits = run.impacts.filter(([tick]) => tick <= now), hit = [...new Set(hits.flatMap(([, who]) => who))].map(i => run.agents[i]);
  get("impact").hidden = !hits.length;
  if (hits.length) {
    const who = `at ${clock(hits[0][0]).toFixed(2)} s: ${hit.slice(0, 6).join(", ")}${hit.length > 6 ? ", ..." : ""}.`;
    get("impact").textContent = run.watched ? `impact ${who} What follows is no driving${run.trail ? " of theirs" : ""}.`
      : `by their places and sizes, bodies touch ${who} What follows may be no driving of theirs.`;
  }
  cursors.forEach(cursor => { cursor.style.left = 100 * now / Math.max(last, 1) + "%"; });
  told.forEach(([row, label, changes]) => { row.firstChild.textContent = `${label}: ${at(changes, now)}`; });
  get("scrub").value = now;
  get("clock").value = time.toFixed(2) + " s";
  const list = get("events"), coming = [...list.children].filter(b => !b.classList.toggle("past", +b.dataset.time < time - 1e-9))[0];
  list.scrollTop = (coming ? coming.offsetTop : list.scrollHeight) - list.clientHeight / 2;
}
function strip([label, changes, until = over]) {
  const row = make("div", get("strips"), "", "row"), name = make("span", row, "", "faint"), bar = make("div", row, "", "strip");
  const share = tick => 100 * tick / Math.max(last, 1) + "%";
  name.title = label;
  changes.forEach(([tick, word], k) => {
    const end = k + 1 < changes.length ? changes[k + 1][0] : last, part = make("i", bar, word, word);
    part.style.left = share(tick);
    part.style.width = share(end - tick);
    part.title = `${label}: ${word} from ${clock(tick).toFixed(2)} s`;
  });
  const ends = Math.min(until, over);
  if (ends < Infinity) {
    const after = make("s", bar);
    after.style.width = share(last - ends);
    after.title = "impact: what follows is no driving";
  }
  run.marked.forEach(time => { make("u", bar).style.left = share((time - run.start) / run.dt); });
  cursors.push(make("b", bar));
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
function toggle() { timer === null ? play() : pause(); }
function go(time) { pause(); show((time - run.start) / run.dt); }
function step(ticks) { pause(); show(now + ticks); }
function link() { const found = location.hash.match(/t=(-?\d+(\.\d*)?)/); if (found) go(+found[1]); }
function timed(parent, time, text, kind) {
  const button = make("button", parent, text, kind);
  button.dataset.time = time;
  button.onclick = () => { history.replaceState(null, "", "#t=" + time.toFixed(2)); go(time); };
}

// The camera: the point in the middle of the view [m], the scale [m per pixel], and the part of the road that the view fits [m].
let middle = [0, 0], grain = 1, fitted = run.home;
function room() { return [scene.clientWidth || 1, scene.clientHeight || 1]; }
function place() {
  const [wide, high] = room();
  scene.setAttribute("viewBox", [middle[0] - wide * grain / 2, middle[1] - high * grain / 2, wide * grain, high * grain].map(v => v.toFixed(3)).join(" "));
}
function look(x, y) { middle = [x, y]; stage.classList.add("moved"); place(); }
function home() {
  const [left, top, right, bottom] = fitted, [wide, high] = room();
  middle = [(left + right) / 2, (top + bottom) / 2];
  grain = Math.max((right - left) / wide, (bottom - top) / high);
  stage.classList.remove("moved");
  place();
}
function fit() { // the part of the road that the page shows at first, and all vehicles that are there now
  if (followed >= 0) follow(followed);
  fitted = [...run.home];
  bodies.forEach((body, i) => {
    if (body.style.display === "none") return;
    const [x, y] = motion(run.motion, now / run.every, i), away = run.lengths[i] + 1;
    fitted = [Math.min(fitted[0], x - away), Math.min(fitted[1], -y - away), Math.max(fitted[2], x + away), Math.max(fitted[3], -y + away)];
  });
  home();
}
function world(x, y) {
  const box = scene.getBoundingClientRect();
  return [middle[0] + (x - box.left - box.width / 2) * grain, middle[1] + (y - box.top - box.height / 2) * grain];
}
function zoom(factor, x, y) { // the point at (x, y) on the screen stays there; a followed vehicle stays in the middle
  const box = scene.getBoundingClientRect(), fixed = followed < 0 && x !== undefined ? [x, y] : [box.left + box.width / 2, box.top + box.height / 2];
  const [u, v] = world(...fixed), [wide] = room(), before = grain;
  grain = Math.max(5 / wide, Math.min(2 * run.reach / wide, grain / factor));
  look(u + (middle[0] - u) * grain / before, v + (middle[1] - v) * grain / before);
}
function follow(i) {
  followed = i === followed || i >= run.agents.length ? -1 : i;
  bodies.forEach((body, k) => body.classList.toggle("followed", k === followed));
  [...get("states").tBodies[0].rows].forEach((row, k) => row.querySelector("button").setAttribute("aria-pressed", k === followed));
  get("follow").textContent = followed < 0 ? "follow" : `following ${run.agents[followed]}`;
  get("follow").setAttribute("aria-pressed", followed >= 0);
  if (followed >= 0) grain = Math.min(grain, 40 / Math.min(...room()));
  show(now);
}
const order = run.agents.map((name, i) => i).sort((a, b) => run.responsible.includes(run.agents[b]) - run.responsible.includes(run.agents[a]));
function next() { // the responsible vehicles, then the other vehicles, then no vehicle
  const there = order.filter(i => bodies[i].style.display !== "none"), k = there.indexOf(followed) + 1;
  if (k < there.length) follow(there[k]); else if (followed >= 0) follow(followed);
}
function haunt() {
  if (!ghosts.length) return;
  const shown = get("ghost").getAttribute("aria-pressed") !== "true";
  get("ghost").setAttribute("aria-pressed", shown);
  ghosts.forEach(body => { body.style.visibility = shown ? "" : "hidden"; });
}
const fingers = new Map();
let travelled = 0, held = null;
scene.addEventListener("pointerdown", event => {
  if (event.button) return;
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  if (fingers.size === 1) { travelled = 0; held = event.target.closest(".vehicle"); }
  stage.classList.add("held");
});
scene.addEventListener("pointermove", event => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const here = [event.clientX, event.clientY], others = [...fingers].filter(([id]) => id !== event.pointerId).map(([, point]) => point);
  const dx = here[0] - before[0], dy = here[1] - before[1];
  travelled += Math.hypot(dx, dy);
  if (travelled < 4) return; // a tap
  scene.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, here);
  if (!others.length) {
    if (followed >= 0) follow(followed);
    look(middle[0] - dx * grain, middle[1] - dy * grain);
  } else {
    const [other] = others, apart = point => Math.max(1, Math.hypot(point[0] - other[0], point[1] - other[1]));
    zoom(apart(here) / apart(before), (here[0] + other[0]) / 2, (here[1] + other[1]) / 2);
    if (followed < 0) look(middle[0] - dx * grain / 2, middle[1] - dy * grain / 2);
  }
});
for (const kind of ["pointerup", "pointercancel"]) scene.addEventListener(kind, event => {
  if (!fingers.delete(event.pointerId)) return;
  if (kind === "pointerup" && travelled < 4 && held && !fingers.size) follow([...bodies].indexOf(held));
  if (!fingers.size) stage.classList.remove("held");
});
scene.addEventListener("wheel", event => {
  if (parent !== window && !event.ctrlKey) return; // within another page, the wheel scrolls that page
  event.preventDefault();
  zoom(Math.exp(-Math.max(-100, Math.min(100, event.deltaY)) * 0.003), event.clientX, event.clientY);
}, {passive: false});
new ResizeObserver(() => stage.classList.contains("moved") ? place() : home()).observe(scene);
get("closer").onclick = () => zoom(1.4);
get("farther").onclick = () => zoom(1 / 1.4);
get("home").onclick = fit;
get("follow").onclick = next;
get("ghost").onclick = haunt;

run.agents.forEach((name, i) => {
  const row = get("states").tBodies[0].insertRow(), kind = run.kinds[i] === "car" ? "" : run.kinds[i] + " ";
  for (let k = 0; k < 4; k++) row.insertCell();
  const button = make("button", row.cells[0]);
  make("i", button).style.background = run.inks[i];
  button.append(kind + name);
  button.title = `follow ${name}`;
  button.setAttribute("aria-pressed", false);
  button.onclick = () => follow(i);
  if (run.responsible.includes(name)) row.cells[0].append(" (responsible)");
});
if (run.kinds.includes("pedestrian")) get("states").tHead.rows[0].cells[0].textContent = "road user";
run.events.forEach(([time, text, marked]) => timed(get("events"), time, `${time.toFixed(2)} s  ${text}`, marked ? "told" : ""));
rows.forEach(strip);
run.facts.forEach(([word, text]) => {
  make("dt", get("facts"), word);
  const said = make("dd", get("facts")), again = word === "rerun", line = make(again || word === "formula" ? "code" : "span", said, text);
  if (!again) return;
  const button = make("button", said, "copy");
  button.id = "copy";
  button.onclick = () => {
    const range = document.createRange();
    range.selectNodeContents(line);
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    button.textContent = document.execCommand("copy") ? "copied" : "selected"; // pages from files have no access to navigator.clipboard
  };
});
get("about").hidden = !run.facts.length;
const idle = run.others.filter(([, status]) => status === "NA");
run.others.filter(other => !idle.includes(other)).forEach(([rule, status, message]) => {
  const [kind, sign] = run.marks[status], item = make("li", get("others"));
  make("b", item, `${sign} ${status}`, `badge ${kind}`);
  const said = message.replace(`${rule} ${status}: `, "");
  make("span", item, said.startsWith(rule) ? said : `${rule}: ${said}`);
});
if (idle.length) {
  const item = make("details", make("li", get("others"))), head = make("summary", item);
  make("b", head, `${run.marks.NA[1]} NA`, "badge none");
  head.append(` ${idle.length} not applicable`);
  for (const [, , message] of idle) make("p", item, message);
}
get("verdicts").hidden = !run.others.length;
if (run.ghost) {
  get("ghost").hidden = !ghosts.length;
  get("ghost").textContent = `earlier run: ${run.ghost.name}`;
  get("parted").hidden = false;
  get("parted").textContent = run.ghost.said + " ";
  for (const [time, text] of run.ghost.times) timed(get("parted"), time, text, "");
}
document.querySelector("h1").title = document.title; // a narrow page cuts the heading off
if (run.back) {
  get("back").href = run.back;
  get("back").hidden = get("back").protocol !== location.protocol; // neither a script nor a page with another protocol
}
if (matchMedia("(max-width:60rem)").matches) document.querySelectorAll("aside details").forEach(one => { one.open = one.contains(get("events")); });
get("scrub").max = last;
get("scrub").oninput = event => { pause(); show(+event.target.value); };
get("play").onclick = toggle;
get("back1").onclick = () => step(-1);
get("on1").onclick = () => step(1);
addEventListener("hashchange", link);
addEventListener("keydown", event => {
  if (event.target.tagName === "SELECT" || event.ctrlKey || event.metaKey || event.altKey) return;
  const jump = event.shiftKey ? 1 / run.dt : 1;
  const act = {" ": toggle, ArrowRight: () => step(jump), ArrowLeft: () => step(-jump), Home: () => go(run.start), End: () => step(last),
    "+": () => zoom(1.4), "=": () => zoom(1.4), "-": () => zoom(1 / 1.4), 0: get("home").onclick, f: next, g: haunt}[event.key];
  if (act) { event.preventDefault(); act(); }
});
home();
go(run.opened);
link();
