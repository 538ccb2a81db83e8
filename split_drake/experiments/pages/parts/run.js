"use strict";
(() => {
  const details = JSON.parse(document.getElementById("details").textContent);
  const body = document.querySelector("#rows tbody");
  const rows = [...body.querySelectorAll("tr.row")];
  const words = document.getElementById("words");
  const failures = document.getElementById("failures");
  const selects = [...document.querySelectorAll(".filters select")];
  const value = (row, column) => row.cells[column + 1].dataset.value;
  const texts = rows.map((row) => row.textContent.toLowerCase());

  for (const select of selects) {
    const counts = new Map();
    for (const row of rows) {
      const found = value(row, +select.dataset.column);
      if (found !== "") counts.set(found, (counts.get(found) || 0) + 1);
    }
    for (const [name, count] of [...counts].sort((a, b) => a[0].localeCompare(b[0], "en", {numeric: true}))) {
      select.add(new Option(`${name} (${count})`, name));
    }
  }

  function close(row) {
    if (row.nextElementSibling && row.nextElementSibling.classList.contains("open-row")) {
      row.nextElementSibling.remove();
      return true;
    }
    return false;
  }

  function filter() {
    const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    rows.forEach((row, number) => {
      const kept = wanted.every((word) => texts[number].includes(word))
        && (!failures.checked || row.classList.contains("bad"))
        && selects.every((select) => !select.value || value(row, +select.dataset.column) === select.value);
      row.hidden = !kept;
      row.style.display = kept ? "" : "none";
      if (!kept) close(row);
      shown += kept;
    });
    document.getElementById("count").textContent = `${shown} of ${rows.length}`;
  }

  function sort(button) {
    const column = +button.dataset.column;
    const down = button.getAttribute("aria-sort") === "ascending";
    const numeric = "numeric" in button.dataset;
    for (const other of document.querySelectorAll("th button")) other.removeAttribute("aria-sort");
    button.setAttribute("aria-sort", down ? "descending" : "ascending");
    const key = (row) => {
      const found = value(row, column);
      return numeric ? (found === "" ? Infinity : +found) : found;
    };
    const order = rows.map((row, number) => [key(row), number, row]);
    order.sort((a, b) => {
      const found = numeric ? a[0] - b[0] || 0 : a[0].localeCompare(b[0], "en", {numeric: true});
      return (down ? -found : found) || a[1] - b[1];
    });
    rows.forEach(close);
    body.append(...order.map((each) => each[2]));
  }

  const element = (tag, text, className) => {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
  };
  const colours = ["#cfe3ec", "#d9ead3", "#fbe5c8", "#e5d9f2", "#f6d5d5", "#d8ece8", "#ece8d0", "#dfe3ea"];
  const colourOf = new Map();
  const colour = (name) => {
    if (!colourOf.has(name)) colourOf.set(name, colours[colourOf.size % colours.length]);
    return colourOf.get(name);
  };

  function trackOf(track) {
    const made = element("div", undefined, "track");
    const head = element("div", `${track.title}: `);
    head.append(element("span", track.outcome, track.good ? "ok" : "failed"));
    made.append(head);
    if (track.facts.length) {
      made.append(element("div", track.facts.map(([name, found]) => `${name}: ${found}`).join("; "), "given"));
    }
    if (track.pieces.length) {
      const line = element("div", undefined, "pieces"), list = element("ul");
      for (const piece of track.pieces) {
        const part = element("span", piece.name, piece.good ? "" : "cut");
        part.style.flex = `${Math.max(piece.seconds, 0.05)} 1 0`;
        part.style.background = colour(piece.name);
        part.title = `${piece.name}, ${piece.seconds.toFixed(1)} s; ${piece.felt}`;
        line.append(part);
        list.append(element("li", `${piece.name}, ${piece.seconds.toFixed(1)} s${piece.felt ? ": " + piece.felt : ""}`));
      }
      made.append(line, list);
    }
    return made;
  }

  function open(row) {
    if (close(row)) return;
    const found = details[row.dataset.key];
    const line = element("tr", undefined, "open-row"), cell = element("td");
    cell.colSpan = row.cells.length;
    if (found.stills.length) {
      const stills = element("div", undefined, "stills");
      for (const still of found.stills) {
        const figure = element("figure"), image = element("img");
        image.src = still.target;
        image.alt = still.shown;
        figure.append(image, element("figcaption", still.shown));
        stills.append(figure);
      }
      cell.append(stills);
    }
    cell.append(...found.tracks.map(trackOf));
    const record = element("details");
    record.append(element("summary", "record"), element("pre", JSON.stringify(found.record, null, 1)));
    cell.append(record);
    line.append(cell);
    row.after(line);
  }

  document.querySelector(".filters").addEventListener("submit", (event) => event.preventDefault());
  words.addEventListener("input", filter);
  failures.addEventListener("change", filter);
  for (const select of selects) select.addEventListener("change", filter);
  for (const button of document.querySelectorAll("th button")) {
    button.addEventListener("click", () => sort(button));
  }
  body.addEventListener("click", (event) => {
    const row = event.target.closest("tr.row");
    if (row && !event.target.closest("a")) open(row);
  });
  body.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && event.target.matches("tr.row")) open(event.target);
  });
  const asked = location.hash && document.getElementById(location.hash.slice(1));
  if (asked && asked.matches("tr.row")) {
    open(asked);
    asked.scrollIntoView();
  }
  filter();
})();
