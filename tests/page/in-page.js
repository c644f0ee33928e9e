// Checks that run inside the page.
(() => {
  "use strict";
  const CONTRAST = { text: 4.5, shape: 3 };

  function linear(channel) {
    const part = channel / 255;
    return part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4;
  }
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  function contrast(one, other) {
    const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  }
  const colour = (text) => (text.match(/[\d.]+/g) || []).slice(0, 3).map(Number);
  const over = (front, back, opacity) => front.map((part, i) => opacity * part + (1 - opacity) * back[i]);
  const paper = () => colour(getComputedStyle(document.documentElement).backgroundColor);

  // Elements wider than the page, except in scrollable boxes.
  function overflows() {
    const width = document.documentElement.clientWidth;
    const found = document.documentElement.scrollWidth > width ? [`the page is ${document.documentElement.scrollWidth} wide`] : [];
    for (const element of document.body.querySelectorAll("*")) {
      if (element.closest(".scroll") !== null && !element.classList.contains("scroll")) continue;
      if (element.classList.contains("skip")) continue;
      const { right, left, width: own } = element.getBoundingClientRect();
      if (own > 0 && (right > width + 0.5 || left < -0.5)) found.push(`${element.tagName} ${element.className} is cut`);
    }
    return found;
  }

  const inside = (a, b) => a.left >= b.left - 1 && a.right <= b.right + 1 && a.top >= b.top - 1 && a.bottom <= b.bottom + 1;
  const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 2 && b.top < a.bottom - 2;

  // Figure labels outside the figure, overlapping or with low contrast, and invisible shapes.
  function pictures() {
    const found = [];
    for (const svg of document.querySelectorAll("svg")) {
      const frame = svg.getBoundingClientRect();
      const texts = [...svg.querySelectorAll("text")].map((text) => [text, text.getBoundingClientRect()]);
      const [title, words] = ["title", "desc"].map((what) => svg.querySelector(what));
      const name = title.id;
      const isTold = svg.getAttribute("aria-labelledby") === `${title.id} ${words.id}` && title.textContent && words.textContent;
      if (svg.getAttribute("role") !== "img" || !isTold) found.push(`${name}: a picture without words`);
      texts.forEach(([text, box], i) => {
        if (!inside(box, frame)) found.push(`${name}: "${text.textContent}" leaves the picture`);
        for (const [other, its] of texts.slice(i + 1)) {
          if (meet(box, its)) found.push(`${name}: "${text.textContent}" and "${other.textContent}" overlap`);
        }
        let back = paper();
        for (const rect of svg.querySelectorAll("rect.flown, rect.used, rect.off, rect.bent, rect.band")) {
          if (!meet(box, rect.getBoundingClientRect())) continue;
          const style = getComputedStyle(rect);
          back = over(colour(style.fill), back, Number(style.opacity));
        }
        const is = contrast(colour(getComputedStyle(text).fill), back);
        if (is < CONTRAST.text) found.push(`${name}: "${text.textContent}" has a contrast of ${is.toFixed(2)}`);
      });
      for (const line of svg.querySelectorAll(".l, .trace, .missed, .moment, .axis")) {
        const style = getComputedStyle(line);
        const is = contrast(over(colour(style.stroke), paper(), Number(style.opacity)), paper());
        if (is < CONTRAST.shape && !line.classList.contains("faint")) found.push(`${name}: ${line.className.baseVal}: ${is.toFixed(2)}`);
      }
    }
    return found;
  }

  // axe does not check SVG figures.
  window.layoutFindings = () => [...overflows(), ...new Set(pictures())];

  const candidates = () =>
    [...document.querySelectorAll("a[href], button, input, select, summary, [tabindex='0']")].filter(
      (element) =>
        element.closest("[hidden]") === null &&
        (element.tagName === "SUMMARY" ? element.parentElement.parentElement : element).closest("details:not([open])") === null,
    );
  window.usableControlCount = () => candidates().length;
  window.focusedControl = () => {
    const element = document.activeElement;
    const style = getComputedStyle(element);
    const { left, right, top, bottom } = element.getBoundingClientRect();
    const isInside = left > -5 && right > 0 && top < innerHeight && bottom > 0;
    const isSeen = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2 && isInside;
    return { number: candidates().indexOf(element), isSeen };
  };

  window.printFindings = () => {
    const found = [];
    for (const hidden of document.querySelectorAll("nav, button, .skip")) {
      if (getComputedStyle(hidden).display !== "none") found.push(`${hidden.tagName} is printed`);
    }
    if (luminance(paper()) < 0.9) found.push("prints a dark page");
    return found;
  };
})();
