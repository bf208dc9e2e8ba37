const rows = [...document.querySelectorAll("#found tbody tr")];
document.getElementById("search").oninput = event => {
  const part = event.target.value.toLowerCase();
  rows.forEach(row => { row.hidden = !row.textContent.toLowerCase().includes(part); });
};
