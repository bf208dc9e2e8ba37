const session = JSON.parse(document.getElementById("data").textContent);
const get = id => document.getElementById(id), page = 300, worst = 20;
let only = null, shown = page;
function pick(found) { only = found; get("status").value = get("rule").value = get("search").value = ""; shown = page; list(); get("bar").scrollIntoView(); }
function chosen() {
  const status = get("status").value, rule = get("rule").value, text = get("search").value.toLowerCase();
  return session.items.filter(item => (!only || only(item)) && (!status || item.status === status) && (!rule || item.rule === rule)
    && (!text || (item.id + " " + item.text).toLowerCase().includes(text)));
}
function list() {
  const found = chosen(), body = get("items").tBodies[0];
  body.replaceChildren();
  found.slice(0, shown).forEach(item => {
    const row = body.insertRow();
    make("span", row.insertCell(), item.status + (item.known ? " (known)" : ""), "s " + session.statuses[item.status]);
    row.insertCell().textContent = item.id;
    row.insertCell().textContent = item.text;
    row.insertCell().textContent = item.driver;
    row.insertCell().textContent = item.simulator;
    const cell = row.insertCell();
    if (item.look) make("a", cell, "replay").href = item.look;
  });
  const rest = session.all - session.items.length, more = rest ? `, without ${rest} that this page leaves out` : "";
  get("count").textContent = `${found.length} of ${session.items.length} items${more}`;
  get("more").hidden = found.length <= shown;
}
session.causes.forEach(block => {
  make("h2", get("causes"), block.title);
  const body = make("table", get("causes"), "", "causes").createTBody();
  block.causes.forEach(cause => {
    const row = body.insertRow(), ids = new Set(cause.ids), told = session.items.filter(item => ids.has(item.id) && item.look);
    row.insertCell().textContent = cause.count + " x";
    row.insertCell().textContent = cause.rule;
    make("button", row.insertCell(), cause.text).onclick = () => pick(item => ids.has(item.id));
    const cell = row.insertCell();
    cell.textContent = `first: ${[block.again, `"${cause.first}"`].join(" ").trim()} `;
    if (told.length) make("a", cell, "replay").href = (told.find(item => item.id === cause.first) || told[0]).look;
  });
});
function draw(matrix, place) {
  make("h3", place, matrix.title);
  const table = make("table", make("div", place, "", "scroll"), "", "matrix");
  const head = table.createTHead().insertRow();
  make("th", head, matrix.corner);
  matrix.columns.forEach(([cfg, rule]) => make("th", head, (cfg + " " + rule).trim()));
  const body = table.createTBody();
  matrix.rows.forEach(([label, cells, members]) => {
    const row = body.insertRow(), here = new Set(members);
    make("th", row, label);
    cells.forEach(([text, bad], k) => {
      const cell = row.insertCell(), [cfg, rule] = matrix.columns[k];
      if (text) make("button", cell, text, bad ? "bad" : "").onclick = () =>
        pick(item => item.group === matrix.title && item.cfg === cfg && item.rule === rule && here.has(item.member));
    });
  });
}
function unfold(row, name) {
  const next = row.nextElementSibling;
  if (next && next.className === "unfolded") { next.remove(); return; }
  const place = document.createElement("tr");
  place.className = "unfolded";
  row.after(place);
  const cell = place.insertCell(), folded = make("div", cell);
  cell.colSpan = row.cells.length;
  session.matrices.filter(matrix => matrix.junction === name).forEach(matrix => draw(matrix, folded));
  make("button", folded, "its items").onclick = () => pick(item => item.junction === name);
}
session.sums.forEach(sum => {
  const table = make("table", make("div", get("sums"), "", "scroll"), "", "sums");
  const head = table.createTHead().insertRow(), body = table.createTBody();
  sum.columns.forEach((heading, k) => make("th", head, heading, sum.sides[k]));
  function add([name, ...cells]) {
    const row = body.insertRow();
    const choose = () => pick(item => item[sum.corner] === name);
    make("button", make("th", row), name).onclick = sum.corner === "junction" ? () => unfold(row, name) : choose;
    cells.forEach((text, k) => {
      const cell = make("td", row, "", sum.sides[k + 1]);
      if (text) make("span", cell, text, sum.marks[k + 1] && "s " + sum.marks[k + 1]);
    });
  }
  sum.rows.slice(0, worst).forEach(add);
  const rest = sum.rows.slice(worst);
  if (rest.length) {
    const button = make("button", get("sums"), `${rest.length} more ${sum.corner}s`);
    button.onclick = () => { button.remove(); rest.forEach(add); };
  }
});
if (session.sums.length) get("matrices").previousElementSibling.hidden = true;
else session.matrices.forEach(matrix => draw(matrix, get("matrices")));
Object.keys(session.statuses).forEach(status => { make("option", get("status"), status).value = status; });
[...new Set(session.items.map(item => item.rule))].sort().forEach(rule => { make("option", get("rule"), rule).value = rule; });
get("status").onchange = get("rule").onchange = get("search").oninput = () => { shown = page; list(); };
get("clear").onclick = () => pick(null);
get("more").onclick = () => { shown += page; list(); };
const root = document.documentElement.dataset;
root.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
get("theme").onclick = () => { root.theme = root.theme === "dark" ? "light" : "dark"; };
list();
