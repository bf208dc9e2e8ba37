const session = JSON.parse(document.getElementById("data").textContent);
const page = 100, worst = 20, few = 10, long = 280;
const failing = session.items.filter(item => item.failed), others = session.items.filter(item => !item.failed);
const failures = session.causes.filter(block => block.failed);
const many = new Set(session.items.map(item => item.driver + "\n" + item.simulator)).size > 1;
let only = null;
const count = (n, thing) => `${n.toLocaleString("en")} ${thing}${n === 1 ? "" : "s"}`;
// Makes a folded part, which gets its content when it is first opened.
function fold(place, title, fill, kind = "") {
  const part = make("details", place, "", kind);
  make("summary", part, title);
  part.ontoggle = () => { part.ontoggle = null; fill(part); };
  return part;
}
function box(place, name) {
  const region = make("div", place, "", "scroll");
  region.tabIndex = 0;
  region.setAttribute("role", "region");
  region.setAttribute("aria-label", name);
  return region;
}
function link(place, item, text) {
  if (item.look) make("a", place, text).href = item.look;
  else if (item.draw) make("code", place, item.draw, "line");
}
function card(list, item) {
  const entry = make("li", list), head = make("p", entry);
  make("span", head, item.status + (item.known ? " (known)" : "") + (item.change ? `, ${item.change}` : ""), "s " + session.statuses[item.status]);
  head.append(" ");
  make("span", head, item.id, "id");
  if (item.text.length > long) {
    const part = fold(entry, item.text.slice(0, long) + " ...", () => make("p", part, item.text), "what");
  } else if (item.text) make("p", entry, item.text);
  if (many && (item.driver || item.simulator)) {
    const makers = [item.driver && `driven by ${item.driver}`, item.simulator && `simulated by ${item.simulator}`];
    make("p", entry, makers.filter(Boolean).join(", "), "made");
  }
  link(entry, item, "replay");
  item.more.forEach((look, number) => { entry.append(" "); make("a", entry, `replay ${number + 2}`).href = look; });
  if (item.why) fold(entry, item.why.split("\n")[0], part => make("pre", part, item.why), "what");
}
function paged(place, matches) {
  const list = make("ol", place, "", "items"), button = make("button", place, "", "more");
  let shown = 0;
  button.onclick = () => {
    matches.slice(shown, shown + page).forEach(item => card(list, item));
    shown = Math.min(shown + page, matches.length);
    button.hidden = shown === matches.length;
    button.textContent = `show more, ${shown} of ${matches.length} are shown`;
  };
  button.onclick();
}
function pick(condition) {
  only = condition;
  get("status").value = get("rule").value = get("search").value = "";
  list();
  get("bar").scrollIntoView();
  get("count").focus({ preventScroll: true });
}
function list() {
  const status = get("status").value, rule = get("rule").value, text = get("search").value.toLowerCase();
  const all = !only && !status && !rule && !text;
  const matches = all ? failing : session.items.filter(item => (!only || only(item)) && (!status || item.status === status)
    && (!rule || item.rule === rule) && (!text || `${item.id} ${item.change} ${item.text}`.toLowerCase().includes(text)));
  const leftOut = session.all - session.items.length, more = leftOut ? `, without ${leftOut.toLocaleString("en")} that this page leaves out` : "";
  get("count").textContent = `${matches.length.toLocaleString("en")}${all ? " failing" : ""} of ${count(session.items.length, "item")}${more}`;
  get("failures").textContent = all ? "failures" : "items found";
  get("grouped").hidden = !all;
  get("found").hidden = get("clear").hidden = all;
  get("found").replaceChildren();
  if (!all) paged(get("found"), matches);
}
function causes(place, block) {
  const listed = make("ol", place, "", "causes");
  function add(cause, number, list = listed) {
    const row = make("li", list), head = make("p", row), ids = new Set(cause.ids);
    const causeItems = session.items.filter(item => ids.has(item.id)), first = causeItems.find(item => item.id === cause.first);
    make("b", head, `${number + 1}.`);
    make("b", head, `${cause.count} x`);
    make("span", head, `${cause.rule}: ${cause.text}`);
    make("code", row, cause.again, "line");
    const actions = make("div", row, "", "do"), linked = first && first.look ? first : causeItems.find(item => item.look) || first;
    if (linked) link(actions, linked, linked === first ? "replay of the first" : "replay of another");
    make("button", actions, count(causeItems.length, "item")).onclick = () => pick(item => ids.has(item.id));
  }
  shorten(place, block.causes, "cause", add, "causes");
}
// Shows the first few entries, and folds the other entries.
function shorten(place, all, thing, add, kind) {
  all.slice(0, few).forEach((entry, number) => add(entry, number));
  if (all.length > few) fold(place, `${all.length - few} more ${thing}s`, part => {
    const list = make(kind === "causes" ? "ol" : "div", part, "", kind);
    all.slice(few).forEach((entry, number) => add(entry, few + number, list));
  });
}
function groups() {
  const allCauses = failures.flatMap(block => block.causes), assigned = new Set(), place = get("grouped");
  const grouped = allCauses.map(cause => {
    const ids = new Set(cause.ids), own = failing.filter(item => ids.has(item.id) && !assigned.has(item.id));
    own.forEach(item => assigned.add(item.id));
    own.sort((a, b) => (b.id === cause.first) - (a.id === cause.first));
    return { title: `${cause.rule}: ${cause.text}`, own };
  });
  grouped.push({ title: "other failures", own: failing.filter(item => !assigned.has(item.id)) });
  const filled = grouped.filter(group => group.own.length);
  if (!filled.length) make("p", place, "No item failed.");
  shorten(place, filled, "cause", ({ title, own }, number, where = place) => {
    const part = make("div", where, "", "group"), head = make("h3", part);
    make("b", head, `${number + 1}.`);
    make("span", head, title);
    card(make("ol", part, "", "items"), own[0]);
    if (own.length > 1) fold(part, `${own.length - 1} more of this cause`, inner => paged(inner, own.slice(1)));
  }, "groups");
}
function draw(matrix, place) {
  make("h3", place, matrix.title);
  const numbers = new Map(Object.entries(matrix.numbers));  // a Map has no inherited names, as an object has
  const table = make("table", box(place, matrix.title), "", "matrix"), head = table.createTHead();
  if (matrix.columns.some(([cfg]) => cfg)) {
    const row = head.insertRow();
    make("td", row);
    matrix.columns.forEach(([cfg], k) => {
      if (k && cfg === matrix.columns[k - 1][0]) row.lastChild.colSpan += 1;
      else make("th", row, numbers.get(cfg) || cfg).scope = "colgroup";
    });
  }
  const rules = head.insertRow();
  [matrix.corner, ...matrix.columns.map(([, rule]) => rule)].forEach(name => { make("th", rules, name).scope = "col"; });
  const body = table.createTBody();
  matrix.rows.forEach(([label, cells, members]) => {
    const row = body.insertRow(), here = new Set(members.map(member => JSON.stringify(member)));
    make("th", row, label).scope = "row";
    cells.forEach(([text, bad], k) => {
      const cell = row.insertCell(), [cfg, rule] = matrix.columns[k];
      if (text) make("button", cell, text, bad ? "bad" : "").onclick = () => pick(item =>
        item.group === matrix.title && item.cfg === cfg && item.rule === rule && here.has(JSON.stringify(item.member)));
    });
  });
  const legend = make("div", place, "", "legend");
  numbers.forEach((number, label) => make("p", legend, `${number} = ${label}`));
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
function summed(place, sum) {
  const table = make("table", box(place, `by ${sum.corner}`), "", "sums");
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
  const hiddenRows = sum.rows.slice(worst);
  if (hiddenRows.length) {
    const button = make("button", place, `${hiddenRows.length} more ${sum.corner}s`);
    button.onclick = () => { button.remove(); hiddenRows.forEach(add); };
  }
}
failures.forEach(block => { make("h2", get("causes"), block.title); causes(get("causes"), block); });
groups();
const place = get("folded");
if (session.sums.length) fold(place, session.rolled, part => session.sums.forEach(sum => summed(part, sum)), "rolled");
else if (session.matrices.length) {
  const title = `verdicts in ${count(session.matrices.length, "table")}`;
  fold(place, title, part => session.matrices.forEach(matrix => draw(matrix, part)), "tables");
}
session.causes.filter(block => !block.failed).forEach(block => {
  fold(place, `${block.title} (${block.causes.reduce((n, cause) => n + cause.count, 0).toLocaleString("en")})`, part => causes(part, block), "others");
});
if (others.length) fold(place, `${count(others.length, "item")} that did not fail`, part => paged(part, others), "passed");
Object.keys(session.statuses).forEach(status => { make("option", get("status"), status).value = status; });
[...new Set(session.items.map(item => item.rule))].sort().forEach(rule => { make("option", get("rule"), rule).value = rule; });
get("status").onchange = get("rule").onchange = get("search").oninput = list;
get("clear").onclick = () => pick(null);
list();
