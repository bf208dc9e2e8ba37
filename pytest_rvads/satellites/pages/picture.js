// A map can be moved and zoomed, with its marks at the same size; a mark chooses the items of its junction.
document.querySelectorAll("svg.map").forEach(view => {
  const [left, top, wide, tall] = view.getAttribute("viewBox").split(" ").map(Number), lanes = [...view.querySelectorAll(".lanes path")];
  const marks = [...view.querySelectorAll("a.mark")], fingers = new Map(), least = 6;
  let at, moved = 0;
  const size = () => { const box = view.getBoundingClientRect(); return [Math.max(box.width, 1), Math.max(box.height, 1)]; };
  function whole() {
    const [w, h] = size();
    at = {x: left + wide / 2, y: top + tall / 2, width: Math.max(wide, tall * w / h)};
  }
  function show() {
    const [w, h] = size(), unit = at.width / w, small = unit * Math.min(1, Math.max(.6, 60 / Math.max(marks.length, 1)));
    view.setAttribute("viewBox", [at.x - at.width / 2, at.y - unit * h / 2, at.width, unit * h].join(" "));
    lanes.forEach(path => path.setAttribute("stroke-width", Math.max(+path.dataset.width, 1.2 * unit)));
    marks.forEach(mark => mark.setAttribute("transform", `translate(${mark.dataset.x} ${mark.dataset.y}) scale(${small})`));
    // Shows names that cover no mark and no other name; the worst junctions come last, and their names first.
    const boxes = [];
    [...marks].reverse().forEach(mark => {
      const text = mark.querySelector("text"), half = 3.3 * small * text.textContent.length, {x, y} = mark.dataset;
      const free = boxes.every(([a, b, other]) => Math.abs(a - x) > half + other || Math.abs(b - y) > 13 * small)
        && marks.every(other => other === mark || Math.abs(other.dataset.x - x) > half + 9 * small || Math.abs(other.dataset.y - y - 21 * small) > 15 * small);
      text.style.display = free ? "" : "none";
      if (free) boxes.push([+x, +y, half]);
    });
  }
  function zoom(factor, x = at.x, y = at.y) {
    const width = Math.min(Math.max(at.width * factor, 30), 4 * Math.max(wide, tall)), real = width / at.width;
    at = {x: x + (at.x - x) * real, y: y + (at.y - y) * real, width};
    show();
  }
  function point(x, y) {
    const box = view.getBoundingClientRect(), unit = at.width / size()[0];
    return [at.x + (x - box.left - box.width / 2) * unit, at.y + (y - box.top - box.height / 2) * unit];
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
  view.addEventListener("click", event => {
    if (moved > least) event.preventDefault();
    else if (event.target.closest("a.mark")?.getAttribute("href") === location.hash) choose();
  });
  view.addEventListener("dragstart", event => event.preventDefault());
  view.addEventListener("keydown", event => {
    const step = at.width / 8, move = {ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step]}[event.key];
    if (move) at = {...at, x: at.x + move[0], y: at.y + move[1]};
    else if (event.key === "+" || event.key === "=") zoom(.7);
    else if (event.key === "-") zoom(1 / .7);
    else if (event.key === "0") whole();
    else return;
    event.preventDefault();
    show();
  });
  addEventListener("resize", show);
  whole();
  show();
});
function choose() {
  let name = "";
  try { name = decodeURIComponent(location.hash.slice(1)); } catch { name = ""; }
  const marks = [...document.querySelectorAll("svg.map a.mark")];
  marks.forEach(mark => mark.classList.toggle("chosen", mark.dataset.name === name));
  if (marks.some(mark => mark.dataset.name === name)) pick(item => item.junction === name);
}
addEventListener("hashchange", choose);
choose();
