"use strict";
// The report: its charts, its print button, and the folds that a link opens.
(() => {
  const charts = Charts.open(JSON.parse(document.getElementById("charts").textContent));
  const button = document.querySelector("[data-print]");
  button.hidden = false;
  button.addEventListener("click", async () => {
    await (await charts).all();
    print();
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
