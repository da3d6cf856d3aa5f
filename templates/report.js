// Sorting of tables by a column, and titles of the pictures at once instead of after a pause. The
// page says everything without it.
(() => {
  const value = (row, i) => row.cells[i].textContent.trim();
  const number = text => parseFloat(text.replace("\u2212", "-"));
  for (const table of document.querySelectorAll("table")) {
    const heads = table.tHead.rows[0].cells, body = table.tBodies[0];
    [...heads].forEach((head, i) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = head.textContent;
      head.replaceChildren(button);
      button.addEventListener("click", () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        for (const other of heads) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        const rows = [...body.rows].sort((a, b) => {
          const [x, y] = [value(a, i), value(b, i)], [p, q] = [number(x), number(y)];
          const order = Number.isFinite(p) && Number.isFinite(q) ? p - q : x.localeCompare(y);
          return up ? order : -order;
        });
        body.append(...rows);
      });
    });
  }
  const tip = document.createElement("div");
  tip.id = "tip";
  tip.hidden = true;
  tip.setAttribute("aria-hidden", "true");
  document.body.append(tip);
  for (const title of document.querySelectorAll("svg g > title")) {
    const group = title.parentNode, text = title.textContent;
    const show = e => {
      tip.textContent = text;
      tip.hidden = false;
      const room = document.documentElement.clientWidth - tip.offsetWidth - 8;
      tip.style.left = Math.max(8, Math.min(e.clientX + 12, room)) + "px";
      tip.style.top = (e.clientY > 60 ? e.clientY - tip.offsetHeight - 8 : e.clientY + 16) + "px";
    };
    group.addEventListener("pointermove", show);
    group.addEventListener("pointerdown", show);
    group.addEventListener("pointerleave", () => { tip.hidden = true; });
    title.remove();
  }
})();
