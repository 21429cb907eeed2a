"use strict";
// The report: its charts, printing, and the folds that a link or the printer opens.
(() => {
  const charts = Charts.open(JSON.parse(document.getElementById("charts").textContent));
  const button = document.querySelector("[data-print]");
  button.hidden = false;
  button.addEventListener("click", async () => {
    await (await charts).all();
    print();
  });
  const opened = new Set();
  addEventListener("beforeprint", () => {
    for (const fold of document.querySelectorAll("details:not([open])")) {
      fold.open = true;
      opened.add(fold);
    }
  });
  addEventListener("afterprint", () => {
    for (const fold of opened) fold.open = false;
    opened.clear();
  });
  const show = () => {
    const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let fold = target.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
    target.scrollIntoView();
  };
  addEventListener("hashchange", show);
  show();
})();
