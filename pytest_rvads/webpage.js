function make(tag, parent, text = "", kind = "") {
  const one = document.createElement(tag);
  one.textContent = text;
  if (kind) one.className = kind;
  parent.append(one);
  return one;
}
