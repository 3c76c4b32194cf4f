// Logging in.

import { h, say } from "./dom.js";
import { t } from "./texts.js";

/** Fetches the visitor's role and login options: `{ role, open, password }`. */
export async function me() {
  const answer = await fetch("/api/me");
  return answer.json();
}

/** Ends the session. */
export async function logOut() {
  await fetch("/api/logout", { method: "POST" });
  location.reload();
}

/** Shows the login form; resolves after a successful login. */
export function logIn(app) {
  return new Promise((resolve) => {
    const input = h("input", {
      id: "password", type: "password", autocomplete: "current-password", required: true,
    });
    const trouble = h("p", { class: "trouble", role: "alert" });
    const submit = async (event) => {
      event.preventDefault();
      const answer = await fetch("/api/login", {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ password: input.value }),
      });
      const said = await answer.json();
      if (answer.ok) {
        return resolve(said);
      }
      say(trouble, said.error);
      input.select();
    };
    app.replaceChildren(h("main", { class: "login" },
      h("form", { class: "card", onsubmit: submit },
        h("img", { src: "/icon.svg", alt: "", width: 48, height: 48 }),
        h("h1", {}, "spykee"),
        h("label", { for: "password" }, t("password")), input,
        h("button", { class: "primary" }, t("login")),
        trouble,
        h("p", { class: "quiet" }, t("login_hint")))));
    input.focus();
  });
}
