// The pictures that scripts have saved: by day and run, those of alarms first.

import { h } from "./dom.js";
import { AGAIN, ask } from "./history.js";
import { showPhoto } from "./photo.js";
import { t } from "./texts.js";

/** The gallery offers so many days. */
const DAYS = 7;
/** Of a run, so many pictures are shown at first. */
const FIRST = 12;

/** The beginning of a day, so many days ago. */
function midnight(ago) {
  const day = new Date();
  day.setHours(0, 0, 0, 0);
  day.setDate(day.getDate() - ago);
  return day;
}

export function gallery(connection) {
  const language = document.documentElement.lang;
  const time = new Intl.DateTimeFormat(language, { hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
  const weekday = new Intl.DateTimeFormat(language, { weekday: "short", day: "numeric" });
  const content = h("div", { class: "days" });
  const title = (ago) => (ago > 1 ? weekday.format(midnight(ago)) : t(ago === 0 ? "today" : "yesterday"));
  const buttons = Array.from({ length: DAYS }, (_, ago) => h("button", { type: "button", onclick: () => choose(ago) }, title(ago)));
  let chosen = 0;
  let shown = "";
  let timer = null;

  function choose(ago) {
    chosen = ago;
    buttons.forEach((button, index) => button.setAttribute("aria-pressed", String(index === ago)));
    show();
  }

  /** A group of pictures below a heading; of many only the first ones, until somebody asks for all. */
  function group(heading, pictures) {
    const photos = pictures.map(({ at, behaviour, name, text }) => ({
      src: `/api/behaviours/${encodeURIComponent(behaviour)}/pictures/${encodeURIComponent(name)}`,
      text: [time.format(new Date(at)), text || behaviour].join(" · "),
      alt: t("picture_of", { name: behaviour, when: time.format(new Date(at)) }),
      says: text,
    }));
    const thumbs = photos.map((photo, index) => {
      const image = h("img", { src: photo.src, alt: photo.alt, loading: "lazy" });
      const thumb = h("button", { type: "button", class: "thumb", hidden: index >= FIRST, onclick: () => showPhoto(photos, index) },
        image, photo.says ? h("span", {}, photo.text) : null);
      // The picture may have been deleted to make room for newer ones.
      image.addEventListener("error", () => thumb.remove());
      return thumb;
    });
    const all = h("button", {
      type: "button", class: "link", hidden: thumbs.length <= FIRST,
      onclick: () => {
        thumbs.forEach((thumb) => { thumb.hidden = false; });
        all.hidden = true;
      },
    }, t("all_pictures", { count: thumbs.length }));
    return h("section", {}, h("h3", {}, heading), h("div", { class: "pictures" }, ...thumbs), all);
  }

  async function show() {
    clearTimeout(timer);
    timer = setTimeout(show, AGAIN);
    const ago = chosen;
    const period = `since=${midnight(ago).getTime()}&until=${midnight(ago - 1).getTime()}`;
    const told = document.hidden && !card.hidden ? null : await ask(`/api/pictures?${period}`);
    const news = JSON.stringify([ago, told]);
    if (!told || ago !== chosen || news === shown) {
      return;
    }
    shown = news;
    card.hidden = false;
    const groups = told.runs.map(({ behaviour, began, pictures }) =>
      group(`${time.format(new Date(began))} ${behaviour}`, pictures));
    if (told.alarms.length > 0) {
      groups.unshift(group(t("lane_alarms"), told.alarms));
    }
    content.replaceChildren(...(groups.length > 0 ? groups : [h("p", { class: "quiet" }, t("no_pictures"))]));
  }

  const card = h("section", { class: "card gallery", "aria-labelledby": "gallery-title", hidden: true },
    h("div", { class: "head" }, h("h2", { id: "gallery-title" }, t("gallery")),
      h("div", { class: "row ranges", role: "group", "aria-label": t("gallery") }, ...buttons)),
    content);
  connection.on("hello", () => choose(chosen));
  return card;
}
