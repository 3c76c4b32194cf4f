// Creates elements. HTML is never parsed from text, so texts of robots and scripts stay text.

const SVG = "http://www.w3.org/2000/svg";
/** Characters that are invisible or change the reading direction. */
const HIDDEN = /[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u061c\u200e\u200f\u2028-\u202e\u2060\u2066-\u2069\ufeff]/g;
/** Requests end after this time: a browser sends only six at once, and STOP must not wait for them. */
export const FETCH_LIMIT = 5000;
const SPOKEN = ["aria-label", "title", "alt"];

/** Replaces hidden characters by visible escapes such as `\u202e`. */
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

/** Creates an HTML element with attributes, listeners (`onclick`) and children. */
export function h(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

/** Creates an SVG element in the same way. */
export function s(name, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

/** Sets a text only if it differs, since screen readers announce changes. */
export function say(element, text) {
  const shown = visible(text);
  if (element.textContent !== shown) {
    element.textContent = shown;
  }
}

/** Limits a number to a range. */
export function within(number, low, high) {
  return Math.min(high, Math.max(low, number));
}

/** A moment for `since`, this many milliseconds ago. */
export function stamp(ago = 0) {
  return { page: performance.now() - ago, day: Date.now() - ago };
}

/** Milliseconds since that moment. The page's clock may stand while the device sleeps; the time of day may be set. */
export function since({ page, day }) {
  return Math.max(performance.now() - page, Date.now() - day);
}

/** Formats seconds as `1:02:03`. */
export function clock(seconds) {
  const two = (number) => String(Math.floor(number)).padStart(2, "0");
  return `${Math.floor(seconds / 3600)}:${two((seconds / 60) % 60)}:${two(seconds % 60)}`;
}

/** Returns a setting stored on this device; the default if storage is not available. */
export function remembered(key, usual) {
  try {
    return localStorage.getItem(`spykee.${key}`) ?? usual;
  } catch {
    return usual;
  }
}

/** Stores a setting on this device. */
export function remember(key, value) {
  try {
    localStorage.setItem(`spykee.${key}`, value);
  } catch {
    // Storage is not available: the setting is lost.
  }
}
