// Shows one compass at a time, the one in use first: a list in each part of the page chooses it for all parts.
(() => {
  "use strict";
  const parts = [...document.querySelectorAll(".compass")];
  const names = [...new Set(parts.map((part) => part.dataset.compass))];
  if (names.length < 2) return;
  const lists = [...new Set(parts.map((part) => part.parentElement))].map((holder) => {
    const line = document.createElement("p");
    const label = line.appendChild(document.createElement("label"));
    label.textContent = "Compass ";
    const list = label.appendChild(document.createElement("select"));
    list.append(...names.map((name) => new Option(name)));
    list.addEventListener("change", () => choose(list.value));
    holder.querySelector(".compass").before(line);
    return list;
  });
  function choose(name) {
    for (const part of parts) part.hidden = part.dataset.compass !== name;
    for (const list of lists) list.value = name;
    dispatchEvent(new Event("compasschosen"));
  }
  choose(names[0]);
})();
