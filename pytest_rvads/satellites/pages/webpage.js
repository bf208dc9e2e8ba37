const get = id => document.getElementById(id), root = document.documentElement.dataset;
function make(tag, parent, text = "", kind = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (kind) element.className = kind;
  parent.append(element);
  return element;
}
const night = matchMedia("(prefers-color-scheme: dark)"); // of the page around, where the page stands in a frame
(night.onchange = () => { root.theme = night.matches ? "dark" : "light"; })();
get("theme").onclick = () => { root.theme = root.theme === "dark" ? "light" : "dark"; };
