"use strict";
for (const button of document.querySelectorAll("button[data-copy]")) {
  button.hidden = false;
  button.addEventListener("click", async () => {
    const from = document.getElementById(button.dataset.copy);
    let done = true;
    try {
      await navigator.clipboard.writeText(from.textContent);
    } catch {
      from.hidden = false;
      getSelection().selectAllChildren(from);
      done = document.execCommand("copy");
    }
    document.getElementById("copied").textContent = done ? "Copied." : "Selected; copy it by hand.";
  });
}
