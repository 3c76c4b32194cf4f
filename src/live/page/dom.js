// Elements are made here, and nowhere from text: whatever a robot or a script says stays text.

const SVG = "http://www.w3.org/2000/svg";
/** Characters that do not show, or that make a text read in another order than it stands. */
const HIDDEN = /[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u061c\u200e\u200f\u2028-\u202e\u2060\u2066-\u2069\ufeff]/g;
const SPOKEN = ["aria-label", "title", "alt"];

/** A text in which nothing hides: what would is shown as `\u202e`. */
export function visible(text) {
  return String(text).replace(HIDDEN, (one) => `\\u${one.charCodeAt(0).toString(16).padStart(4, "0")}`);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) {
      element.addEventListener(name.slice(2), value);
    } else if (value === true) {
      element.setAttribute(name, "");
    } else if (value !== false && value !== null && value !== undefined) {
      element.setAttribute(name, SPOKEN.includes(name) ? visible(value) : value);
    }
  }
  const shown = children.filter((child) => child !== null && child !== undefined);
  element.append(...shown.map((child) => (child instanceof Node ? child : visible(child))));
  return element;
}

/** An element of HTML with attributes, listeners (`onclick`) and children. */
export function h(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

/** The same of SVG. */
export function s(name, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

/** Changes a text only if it is another: screen readers say what changes. */
export function say(element, text) {
  const shown = visible(text);
  if (element.textContent !== shown) {
    element.textContent = shown;
  }
}

/** A number within two bounds. */
export function within(number, low, high) {
  return Math.min(high, Math.max(low, number));
}

/** Seconds as `1:02:03`. */
export function clock(seconds) {
  const two = (number) => String(Math.floor(number)).padStart(2, "0");
  return `${Math.floor(seconds / 3600)}:${two((seconds / 60) % 60)}:${two(seconds % 60)}`;
}

/** What is remembered on this device; nothing if the browser does not let us. */
export function remembered(key, usual) {
  try {
    return localStorage.getItem(`spykee.${key}`) ?? usual;
  } catch {
    return usual;
  }
}

/** Remembers it. */
export function remember(key, value) {
  try {
    localStorage.setItem(`spykee.${key}`, value);
  } catch {
    // It is forgotten then.
  }
}
