const session = JSON.parse(document.getElementById("data").textContent);
const get = id => document.getElementById(id), page = 300;
let only = null, shown = page;
function make(tag, parent, text = "", kind = "") {
  const one = document.createElement(tag);
  one.textContent = text;
  if (kind) one.className = kind;
  parent.append(one);
  return one;
}
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
  get("count").textContent = `${found.length} of ${session.items.length} items`;
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
    cell.textContent = "first: " + cause.first + " ";
    if (told.length) make("a", cell, "replay").href = (told.find(item => item.id === cause.first) || told[0]).look;
  });
});
session.matrices.forEach(matrix => {
  make("h3", get("matrices"), matrix.title);
  const table = make("table", make("div", get("matrices"), "", "scroll"), "", "matrix");
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
});
Object.keys(session.statuses).forEach(status => { make("option", get("status"), status).value = status; });
[...new Set(session.items.map(item => item.rule))].sort().forEach(rule => { make("option", get("rule"), rule).value = rule; });
get("status").onchange = get("rule").onchange = get("search").oninput = () => { shown = page; list(); };
get("clear").onclick = () => pick(null);
get("more").onclick = () => { shown += page; list(); };
const root = document.documentElement.dataset;
root.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
get("theme").onclick = () => { root.theme = root.theme === "dark" ? "light" : "dark"; };
list();
