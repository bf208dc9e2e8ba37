const told = JSON.parse(document.getElementById("data").textContent), few = 10, worst = 50, long = 40;
function folded(place, rest, what) {
  const more = make("details", place);
  make("summary", more, `${rest.length} more ${what}`);
  return more;
}
function list(place, lines) {
  const all = make("ul", place);
  lines.forEach(line => make("li", all, line));
}
function table(place, columns, rows) {
  const drawn = make("table", make("div", place, "", "scroll"));
  const head = make("tr", make("thead", drawn)), body = make("tbody", drawn);
  columns.forEach(column => make("th", head, column));
  rows.forEach(cells => {
    const row = make("tr", body);
    cells.forEach(([text, mark], k) => {
      const kind = text === told.same ? "same" : [mark, text.length > long ? "long" : ""].join(" ").trim();
      make(k ? "td" : "th", row, text, kind);
    });
  });
}
told.parts.forEach((part, number) => {
  const place = make("section", document.getElementById("parts"), "", number < 2 ? "side" : "");
  make("h2", place, part.title);
  const all = part.columns.length ? part.rows : part.lines;
  const draw = part.columns.length ? (where, some) => table(where, part.columns, some) : list;
  const most = part.columns.length ? worst : few, rest = all.slice(most);
  draw(place, all.slice(0, most));
  if (rest.length) draw(folded(place, rest, part.columns.length ? "rows" : "lines"), rest);
});
