// What the tests ask of a page. One expression: an object of functions, evaluated in the page.
(() => {
  // -- Contrast (WCAG 2.2, 1.4.3) ------------------------------------------------------------
  const rgba = text => {
    const [r, g, b, a = 1] = text.match(/[\d.]+/g).map(Number);
    return text.startsWith("color(srgb") ? [255 * r, 255 * g, 255 * b, a] : [r, g, b, a];
  };
  const over = (top, below) => [0, 1, 2].map(i => top[i] * top[3] + below[i] * (1 - top[3])).concat(1);
  const linear = v => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const luminance = c => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const contrast = (a, b) => {
    const [light, dark] = [luminance(a), luminance(b)].sort((p, q) => q - p);
    return (light + 0.05) / (dark + 0.05);
  };
  const canvas = () =>
    matchMedia("(prefers-color-scheme: dark)").matches ? [18, 18, 18, 1] : [255, 255, 255, 1];
  // Colour behind an element's text; null where a picture lies behind it.
  const ground = element => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) {
      const style = getComputedStyle(e);
      if (style.backgroundImage !== "none") return null;
      layers.push(rgba(style.backgroundColor));
      if (layers.at(-1)[3] >= 1) break;
    }
    return layers.reverse().reduce((below, layer) => over(layer, below), canvas());
  };
  const shown = e => e.checkVisibility({ opacityProperty: true, visibilityProperty: true });
  const boxed = e => {
    for (let p = e.parentElement; p && p !== document.body; p = p.parentElement)
      if (getComputedStyle(p).overflowX !== "visible") return true;
    return false;
  };

  // -- Bokeh's views -------------------------------------------------------------------------
  const figureViews = () => {
    const found = [];
    const descend = view => {
      if (!view) return;
      if (view.model && view.model.type === "Figure") found.push(view);
      for (const child of view.child_views ?? []) descend(child);
    };
    if (typeof Bokeh !== "undefined") for (const root of Bokeh.index) descend(root);
    return found;
  };
  const figureView = name => {
    const views = figureViews();
    const named = test => views.find(v => test(v.model.name ?? ""));
    return named(n => n === name) ?? named(n => n.startsWith(name));
  };

  // A node and all below it, those in shadow trees too.
  const within = node =>
    [node, ...[...(node.shadowRoot?.children ?? []), ...(node.children ?? [])].flatMap(within)];

  const stops = (window.__tabStops ??= []);

  return {
    overflow: () =>
      document.scrollingElement.scrollWidth - document.documentElement.clientWidth,

    tooWide: () => {
      const width = document.documentElement.clientWidth;
      return [...document.querySelectorAll("body *")]
        .map(e => [e, e.getBoundingClientRect().right])
        .filter(([e, right]) => right > width + 1 && shown(e) && !boxed(e))
        .map(([e, right]) => `${e.tagName}.${e.className} to ${Math.round(right)} of ${width}`)
        .slice(0, 10);
    },

    lowContrast: () => {
      const bad = new Set();
      const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
      while (walk.nextNode()) {
        const e = walk.currentNode.parentElement;
        const words = walk.currentNode.textContent.trim();
        if (!words || !shown(e)) continue;
        if (e.closest("script, style, noscript, [disabled], [aria-hidden=true]")) continue;
        const style = getComputedStyle(e);
        const below = ground(e);
        if (below === null) continue;
        const size = parseFloat(style.fontSize);
        const large = size >= 24 || (parseInt(style.fontWeight) >= 700 && size >= 18.66);
        const ink = e instanceof SVGElement ? style.fill : style.color;
        const got = contrast(over(rgba(ink), below), below);
        if (got < (large ? 3 : 4.5))
          bad.add(`${got.toFixed(2)}: ${ink} on ${below.slice(0, 3).map(Math.round)}: ` +
            words.slice(0, 40));
      }
      return [...bad].slice(0, 20);
    },

    unnamed: () => {
      const name = e =>
        ["aria-label", "aria-labelledby", "alt", "title"]
          .map(key => e.getAttribute(key)).concat(e.textContent).join("").trim();
      const bad = [...document.querySelectorAll("a[href], button, summary, img, [role=img]")]
        .filter(e => e.checkVisibility() && !name(e))
        .map(e => e.outerHTML.slice(0, 80));
      if (!document.documentElement.lang) bad.push("<html> without lang");
      if (!document.title) bad.push("no title");
      if (document.querySelectorAll("h1").length !== 1) bad.push("not exactly one h1");
      const ids = [...document.querySelectorAll("[id]")].map(e => e.id);
      for (const id of new Set(ids.filter((id, i) => ids.indexOf(id) !== i))) bad.push(`twice: #${id}`);
      return bad;
    },

    // What has the focus, null once it has left the page; the same element has the same id again.
    focused: () => {
      let e = document.activeElement;
      while (e?.shadowRoot?.activeElement) e = e.shadowRoot.activeElement;
      if (!e || e === document.body) return null;
      if (!stops.includes(e)) stops.push(e);
      const style = getComputedStyle(e);
      const box = e.getBoundingClientRect();
      const ring =
        (style.outlineStyle !== "none" && parseFloat(style.outlineWidth) > 0) ||
        style.boxShadow !== "none";
      return {
        id: stops.indexOf(e),
        tag: e.tagName.toLowerCase(),
        name: (e.getAttribute("aria-label") || e.textContent || "").trim().slice(0, 60),
        href: e.getAttribute("href"),
        seen: ring && box.width > 0 && box.bottom > 0 && box.top < innerHeight,
      };
    },

    blur: () => document.activeElement?.blur(),

    remember: selector => {
      const place = document.querySelector(selector);
      const texts = ((window.__remembered ??= {})[selector] = new Set([place.innerText]));
      new MutationObserver(() => texts.add(place.innerText)).observe(place, {
        subtree: true, childList: true, characterData: true,
      });
    },

    remembered: selector => [...window.__remembered[selector]],

    // -- Figures -----------------------------------------------------------------------------
    drawn: () =>
      document.readyState === "complete" &&
      (typeof Bokeh === "undefined" || Bokeh.documents.every(d => d.is_idle)),

    figures: () =>
      figureViews().map(view => {
        const box = view.el.getBoundingClientRect();
        const axes = [...view.model.below, ...view.model.left];
        return {
          name: view.model.name,
          title: view.model.title?.text ?? "",
          width: box.width,
          height: box.height,
          axes: axes.map(axis => axis.axis_label).filter(Boolean),
          background: view.model.background_fill_color,
        };
      }),

    // Texts of the boxes that stand under the pointer; they live in shadow trees.
    tips: () =>
      within(document.body)
        .filter(e => e.classList?.contains("bk-Tooltip") && e.shadowRoot && e.checkVisibility())
        .map(e => within(e.shadowRoot).filter(c => c.tagName !== "STYLE" && !c.children?.length)
          .map(c => c.textContent.trim()).filter(Boolean).join(" "))
        .filter(Boolean),

    inks: place => {
      const canvases = [...document.querySelectorAll(place)].flatMap(within)
        .filter(e => e.tagName === "CANVAS" && e.width && e.height);
      const inks = new Set();
      for (const canvas of canvases) {
        const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
        for (let i = 0; i < data.length; i += 4)
          if (data[i + 3] > 200) inks.add((data[i] >> 4 << 8) | (data[i + 1] >> 4 << 4) | data[i + 2] >> 4);
      }
      return inks.size;
    },

    scrollTo: name => {
      const view = figureView(name);
      view?.el.scrollIntoView({ block: "center", behavior: "instant" });
      return view !== undefined;
    },

    // Where a point of a figure's own units lies in the window [px].
    point: ([name, x, y]) => {
      const { frame, canvas_view } = figureView(name);
      const box = canvas_view.el.getBoundingClientRect();
      const py = y === null ? frame.bbox.y_center : frame.y_scale.compute(y);
      return { x: box.x + frame.x_scale.compute(x), y: box.y + py };
    },
  };
})()
