// The real robots, for a learner: the place in the queue and, on one's turn, the switch between the simulated and the
// real robot.

import { h, say } from "/dom.js";
import { t } from "/texts.js";

/** Formats seconds as `2:05`. */
export const minutes = (seconds) => `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;

/** `post` sends a request; `changed` is called when another robot is chosen. */
export function turns(post, changed) {
  let now = null;
  let turn = null;
  let real = false;
  const words = h("p", { role: "status" });
  const left = h("p", { class: "figure", hidden: true });
  const want = h("button", { type: "button", onclick: () => post("turn", { on: !now.place && !turn }) });
  const choose = (is) => {
    real = is;
    for (const [button, on] of [[simulated, !is], [genuine, is]]) {
      button.setAttribute("aria-pressed", String(on));
    }
    changed();
  };
  const simulated = h("button", { type: "button", onclick: () => choose(false) }, t("simulated_robot"));
  const genuine = h("button", { type: "button", onclick: () => choose(true) }, t("real_robot"));
  const which = h("div", { class: "which", role: "group", "aria-label": t("which_robot"), hidden: true }, simulated, genuine);
  const element = h("section", { class: "card turn", "aria-label": t("real_robots"), hidden: true }, which, left, words, want);

  function sentence() {
    if (turn) {
      const hint = !turn.starts ? t(`robot_${turn.state}`) : t("start_in");
      return `${t("your_turn", { robot: turn.robot })} ${hint}`;
    }
    if (now.place) {
      const { place, wait } = now;
      return wait === null ? t("waits_no_robot", { place }) : t("waits", { place, minutes: Math.ceil(wait / 60) });
    }
    return t("turn_none");
  }

  return {
    element,
    /** The turn, while the real robot is chosen. */
    get real() { return real ? turn : null; },
    show(view) {
      now = view;
      element.hidden = !view;
      const next = view?.turn ?? null;
      const other = next?.number !== turn?.number;
      turn = next;
      if (!view) {
        return;
      }
      which.hidden = left.hidden = !turn;
      say(left, turn ? minutes(turn.left) : "");
      say(words, sentence());
      say(want, t(turn ? "turn_end" : now.place ? "turn_leave" : "turn_want"));
      element.classList.toggle("mine", turn !== null);
      if (other) {
        choose(turn !== null);
      }
    },
  };
}
