const town = JSON.parse(document.getElementById("data").textContent), page = 200;
const view = get("view");
const bodies = {good: "M-9 0a9 9 0 1 0 18 0a9 9 0 1 0 -18 0", bad: "M-8.5 -8.5h17v17h-17z", doubt: "M0 -11.5L11.5 0L0 11.5L-11.5 0z",
  error: "M-10 -6L0 -11L10 -6V6L0 11L-10 6z", none: "M-8 0a8 8 0 1 0 16 0a8 8 0 1 0 -16 0"};
const signs = {good: "M-4 0L-1 3.2L4.2 -3.6", bad: "M-3.8 -3.8L3.8 3.8M3.8 -3.8L-3.8 3.8", doubt: "M0 -5.5V1.5M0 5V5.2", error: "M3.6 -4.6H-3V4.6H3.6M-3 0H2.6", none: "M-3.2 0H3.2"};
const least = 6, names = new Map(town.junctions.map(site => [site.name, site]));
let at = {x: 0, y: 0, width: 1}, map = -1, chosen = null, shown = page, fingers = new Map(), moved = 0;
function draw(tag, parent, values) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  Object.entries(values).forEach(([name, value]) => element.setAttribute(name, value));
  parent.append(element);
  return element;
}
function symbol(parent, state) {
  const body = draw("path", parent, {class: "body", d: bodies[state]});
  draw("path", parent, {class: "sign", d: signs[state]});
  return body;
}
function icon(parent, state) {
  const svg = draw("svg", parent, {viewBox: "-13 -13 26 26", class: "mark " + state, "aria-hidden": "true"});
  symbol(svg, state);
}
// Some converters join ids to long ids, which would cover the map. The title of a mark and its section have the whole id.
function short(id) { return id.length > 12 ? `${id.slice(0, 4)}\u2026${id.slice(-5)}` : id; }
function link(name) { return "#" + encodeURIComponent(name); }
function size() { const box = view.getBoundingClientRect(); return [Math.max(box.width, 1), Math.max(box.height, 1)]; }
function whole() {
  const [x, y, wide, tall] = town.maps[map].view, [w, h] = size();
  at = {x: x + wide / 2, y: y + tall / 2, width: Math.max(wide, tall * w / h)};
}
function show() {
  const [w, h] = size(), unit = at.width / w;
  view.setAttribute("viewBox", [at.x - at.width / 2, at.y - unit * h / 2, at.width, unit * h].join(" "));
  get("lanes").querySelectorAll("path").forEach(path => path.setAttribute("stroke-width", Math.max(+path.dataset.width, 1.2 * unit)));
  const many = Math.min(1, Math.max(.6, 60 / Math.max(get("marks").childElementCount, 1)));
  get("marks").querySelectorAll("a").forEach(mark => {
    mark.setAttribute("transform", `translate(${mark.dataset.x} ${mark.dataset.y}) scale(${unit * many})`);
  });
  // Shows names that cover no mark and no other name: the name of the chosen junction first, then the names of the worst junctions, which come last.
  const boxes = [], grain = unit * many, marks = [...get("marks").children];
  [...marks].reverse().sort((a, b) => (b.dataset.name === chosen) - (a.dataset.name === chosen)).forEach(mark => {
    const text = mark.querySelector("text"), half = 3.3 * grain * text.textContent.length, picked = mark.dataset.name === chosen;
    const free = boxes.every(([x, y, wide]) => Math.abs(x - mark.dataset.x) > half + wide || Math.abs(y - mark.dataset.y) > 13 * grain);
    const clear = marks.every(other => other === mark || Math.abs(other.dataset.x - mark.dataset.x) > half + 9 * grain
      || Math.abs(other.dataset.y - mark.dataset.y - 21 * grain) > 15 * grain);
    const named = picked || free && clear && unit < 1.2 && !mark.classList.contains("none");
    text.style.display = named ? "" : "none";
    if (named) boxes.push([+mark.dataset.x, +mark.dataset.y, half]);
  });
  const step = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find(metres => metres / unit >= 60) || 10000;
  get("scale").textContent = `${Math.round(at.width)} m wide`;
  get("scale").title = `${step} m are ${Math.round(step / unit)} pixels`;
}
function zoom(factor, x = at.x, y = at.y) {
  const width = Math.min(Math.max(at.width * factor, 30), 4 * Math.max(town.maps[map].view[2], town.maps[map].view[3]));
  const real = width / at.width;
  at = {x: x + (at.x - x) * real, y: y + (at.y - y) * real, width};
  show();
}
function point(x, y) {
  const box = view.getBoundingClientRect(), unit = at.width / size()[0];
  return [at.x + (x - box.left - box.width / 2) * unit, at.y + (y - box.top - box.height / 2) * unit];
}
function open(number) {
  if (number === map) return;
  map = number;
  get("map").value = number;
  ["lanes", "areas", "marks"].forEach(id => get(id).replaceChildren());
  town.maps[map].lanes.forEach(([width, d]) => { draw("path", get("lanes"), {d}).dataset.width = width; });
  // The worst junctions come last, so that their marks lie on top.
  town.junctions.filter(site => site.map === map && site.spot).reverse().forEach(site => {
    const [x, y, radius] = site.spot;
    if (site.state !== "none") draw("circle", get("areas"), {cx: x, cy: y, r: radius, class: site.state});
    const mark = draw("a", get("marks"), {href: link(site.name), class: "mark " + site.state, "aria-label": `${site.name}: ${site.told}`});
    Object.assign(mark.dataset, {x, y, name: site.name});
    draw("title", mark, {}).textContent = `${site.name}: ${site.told}`;
    symbol(mark, site.state);
    draw("text", mark, {y: 25}).textContent = short(site.id);
  });
  whole();
  show();
}
function tell(site) {
  const part = get("one");
  part.replaceChildren();
  if (!site) return;
  const head = make("h2", part);
  icon(head, site.state);
  head.append(`${site.name}: ${site.told}`);
  make("p", part, site.kind);
  site.notes.forEach(text => make("p", part, text));
  if (site.rules.length) {
    const table = make("table", make("div", part, "", "scroll")), row = table.createTHead().insertRow();
    make("th", row, "rule");
    site.configurations.forEach(name => make("th", row, name));
    const body = table.createTBody();
    site.rules.forEach(([rule, cells]) => {
      const line = body.insertRow();
      make("th", line, rule);
      cells.forEach(([text, state]) => { make("td", line, text, state); });
    });
  }
  site.causes.forEach(([title, causes]) => {
    make("h3", part, title);
    causes.forEach(cause => {
      const line = make("p", part, `${cause.count} x ${cause.rule}: ${cause.text} `);
      if (cause.look) make("a", line, "replay").href = cause.look;
      const again = make("p", part, "first: ");
      make("code", again, cause.again);
    });
  });
  if (site.again) make("code", make("p", part, "all runs of the junction again: "), site.again);
}
function choose() {
  let name = "";
  try { name = decodeURIComponent(location.hash.slice(1)); } catch { name = ""; }
  const site = names.get(name);
  chosen = site ? name : null;
  if (site) {
    open(site.map);
    if (site.spot) {
      const [x, y, radius] = site.spot, [w, h] = size(), tall = at.width * h / w;
      if (Math.abs(x - at.x) > .45 * at.width || Math.abs(y - at.y) > .45 * tall) at = {...at, x, y};
    }
  }
  tell(site);
  document.querySelectorAll("#marks a, #list a").forEach(mark => mark.classList.toggle("chosen", mark.dataset.name === chosen));
  show();
  if (site && innerWidth < 800) get("one").scrollIntoView();
}
function list() {
  const part = get("search").value.toLowerCase();
  const matches = town.junctions.filter(site => [site.name, site.kind, site.told, ...site.notes].join(" ").toLowerCase().includes(part));
  get("list").replaceChildren();
  matches.slice(0, shown).forEach(site => {
    const line = make("a", make("li", get("list")));
    line.href = link(site.name);
    line.dataset.name = site.name;
    icon(line, site.state);
    const text = make("span", line, town.maps.length > 1 ? site.name : site.id);
    make("small", text, `${site.told}; ${site.kind}`);
  });
  get("count").textContent = `${matches.length} of ${town.junctions.length}`;
  get("more").hidden = matches.length <= shown;
}
view.addEventListener("wheel", event => {
  event.preventDefault();
  zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY * (event.deltaMode ? 20 : 1))) / 300), ...point(event.clientX, event.clientY));
}, {passive: false});
view.addEventListener("pointerdown", event => {
  if (!fingers.size) moved = 0;
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
});
addEventListener("pointermove", event => {
  const before = fingers.get(event.pointerId), unit = at.width / size()[0];
  if (!before) return;
  const now = [event.clientX, event.clientY], other = [...fingers].find(([id]) => id !== event.pointerId);
  moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
  fingers.set(event.pointerId, now);
  if (other) {
    const far = spot => Math.max(Math.hypot(spot[0] - other[1][0], spot[1] - other[1][1]), 1);
    zoom(far(before) / far(now), ...point(...other[1]));
  } else if (moved > least) {
    at = {...at, x: at.x - (now[0] - before[0]) * unit, y: at.y - (now[1] - before[1]) * unit};
    show();
  }
});
["pointerup", "pointercancel"].forEach(kind => addEventListener(kind, event => fingers.delete(event.pointerId)));
// A click chooses the nearest junction, however small its mark is; the keyboard follows the links of the marks.
view.addEventListener("click", event => {
  if (!event.detail) return;
  event.preventDefault();
  if (moved > least) return;
  const [x, y] = point(event.clientX, event.clientY), unit = at.width / size()[0];
  const far = site => Math.hypot(site.spot[0] - x, site.spot[1] - y);
  const near = town.junctions.filter(site => site.map === map && site.spot).sort((a, b) => far(a) - far(b))[0];
  if (near && far(near) < Math.max(26 * unit, near.spot[2])) location.hash = link(near.name);
});
view.addEventListener("dragstart", event => event.preventDefault());
view.addEventListener("keydown", event => {
  const step = at.width / 8, act = {ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step]}[event.key];
  if (act) at = {...at, x: at.x + act[0], y: at.y + act[1]};
  else if (event.key === "+" || event.key === "=") zoom(.7);
  else if (event.key === "-") zoom(1 / .7);
  else if (event.key === "0") whole();
  else return;
  event.preventDefault();
  show();
});
get("in").onclick = () => zoom(.7);
get("out").onclick = () => zoom(1 / .7);
get("all").onclick = () => { whole(); show(); };
get("map").onchange = event => open(+event.target.value);
get("search").oninput = () => { shown = page; list(); };
get("more").onclick = () => { shown += page; list(); };
town.maps.forEach((townMap, number) => { make("option", get("map"), townMap.name).value = number; });
get("map").hidden = town.maps.length < 2;
town.legend.forEach(([state, text]) => { const line = make("li", get("legend")); icon(line, state); line.append(text); });
addEventListener("hashchange", choose);
addEventListener("resize", show);
list();
open(town.junctions[0]?.map ?? 0); // the map of the worst junction
choose();
