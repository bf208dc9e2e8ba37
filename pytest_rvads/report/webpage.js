const get = id => document.getElementById(id), root = document.documentElement.dataset;
function make(tag, parent, text = "", kind = "") {
  const one = document.createElement(tag);
  one.textContent = text;
  if (kind) one.className = kind;
  parent.append(one);
  return one;
}
root.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
get("theme").onclick = () => { root.theme = root.theme === "dark" ? "light" : "dark"; };
