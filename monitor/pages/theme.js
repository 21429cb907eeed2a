"use strict";
// Light and dark: what the reader's system says, or what the page's button says. Bokeh draws on canvases, which know no
// style sheet: charts are made in the light colours, and this exchanges them in every model of a document.
const Theme = (() => {
  const darkByLight = __DARK_BY_LIGHT__;
  const lightByDark = Object.fromEntries(Object.entries(darkByLight).map(([light, dark]) => [dark, light]));
  const system = matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  const shown = new Set();
  let printing = false;

  const chosen = () => root.dataset.theme;
  const dark = () => !printing && (chosen() ? chosen() === "dark" : system.matches);

  const recolour = (value, table) => {
    if (typeof value === "string") return table[value.toLowerCase()] ?? value;
    if (Array.isArray(value)) return value.map((one) => recolour(one, table));
    if (value && typeof value === "object" && typeof value.value === "string") {
      const other = recolour(value.value, table);
      return other === value.value ? value : { ...value, value: other };
    }
    return value;
  };
  // Exchanges the colours of one Bokeh document.
  const restyle = (doc) => {
    const table = dark() ? darkByLight : lightByDark;
    for (const model of doc.all_models) {
      const changed = {};
      for (const [name, value] of Object.entries(model.attributes)) {
        if (!name.endsWith("color") && name !== "palette" && name !== "text_outline_color") continue;
        const other = recolour(value, table);
        if (JSON.stringify(other) !== JSON.stringify(value)) changed[name] = other;
      }
      if (Object.keys(changed).length) model.setv(changed);
    }
  };
  const changed = () => {
    for (const doc of shown) restyle(doc);
    const button = document.querySelector("[data-switch-theme]");
    if (button) button.textContent = dark() ? "Light" : "Dark";
  };
  // From now on a document follows the theme; it comes in the light colours.
  const follow = (doc) => {
    shown.add(doc);
    if (dark()) restyle(doc);
  };
  const remember = (theme) => {
    try {
      localStorage.setItem("mavsentry-theme", theme);
    } catch {
      // A page opened from a file may have no storage: the choice then lasts as long as the page.
    }
  };
  try {
    const theme = localStorage.getItem("mavsentry-theme");
    if (theme === "light" || theme === "dark") root.dataset.theme = theme;
  } catch {
    // As above.
  }
  system.addEventListener("change", changed);
  addEventListener("beforeprint", () => { printing = true; changed(); });
  addEventListener("afterprint", () => { printing = false; changed(); });
  document.addEventListener("DOMContentLoaded", () => {
    const button = document.querySelector("[data-switch-theme]");
    if (!button) return;
    button.hidden = false;
    button.addEventListener("click", () => {
      root.dataset.theme = dark() ? "light" : "dark";
      remember(root.dataset.theme);
      changed();
    });
    changed();
  });
  return { dark, follow, restyle };
})();
