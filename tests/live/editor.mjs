// Tests the editor and the blocks of the class page in Chromium, under the policy of our own pages: by keyboard,
// with axe, and with the real program for marks and lessons. `scripts/check-editor` runs it.

import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import fs from "node:fs";
import http from "node:http";
import { createRequire } from "node:module";
import os from "node:os";
import path from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { executablePath } from "./browser.mjs";

const [spykee, tools, pictures, only = ""] = process.argv.slice(2);
const require = createRequire(path.join(tools, "/"));
const { chromium } = require("playwright-core");
const axe = fs.readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
const root = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
const read = (...names) => fs.readFileSync(path.join(root, ...names), "utf8");
const { generate } = await import(pathToFileURL(path.join(root, "target/editor/blocks.js")));
const work = fs.mkdtempSync(path.join(os.tmpdir(), "spykee-editor-"));
const POLICY = /const POLICY: &str = "([^"]*)"/.exec(read("src/http/middleware.rs"))[1].replace(/\\\s*/g, "");
const LESSONS = fs.readdirSync(path.join(root, "tests/lessons/blocks")).map((file) => file.slice(0, 2));
const state = (lesson) => JSON.parse(read("tests/lessons/blocks", `${lesson}.json`));

/** Writes a script. Returns its path. */
function script(luau) {
  const file = path.join(work, "script.lua");
  fs.writeFileSync(file, luau);
  return file;
}

/** What `spykee check` says, as the class page hands it to the editor. */
function marks(luau) {
  const { stdout } = spawnSync(spykee, ["check", "--json", script(luau)], { encoding: "utf8" });
  return JSON.parse(stdout).map(({ width, ...mark }) => ({ ...mark, end_column: mark.column + width }));
}

/** The table of the API: calls, then events. */
function completions() {
  const rows = (args) => execFileSync(spykee, ["api", ...args], { encoding: "utf8" }).split("\n").filter((line) => /^\S+ {2,}|^\S.*\) {2,}/.test(line));
  const entry = (kind) => (line) => {
    const [signature, doc] = line.split(/ {2,}/);
    return { name: signature.replace(/\(.*/, ""), kind, signature, doc };
  };
  return [...rows([]).map(entry("function")), ...rows(["easy"]).filter((line) => line.startsWith("easy.")).map(entry("function")), ...rows(["events"]).map(entry("event"))];
}

const PAGE = `<!doctype html><html lang="LANG"><head><meta charset="utf-8"><title>class</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="stylesheet" href="/style.css"><link rel="stylesheet" href="/test.css"><script type="module" src="/test.js"></script></head>
<body><main><h1>Lesson 3: moving</h1><button id="before" type="button">Run</button><div id="place"></div><button id="after" type="button">Check</button></main></body></html>`;
const FILES = {
  "/test.css": ["text/css", "main { display: flex; flex-direction: column; gap: 12px; height: 100vh; padding: 16px; } #place { flex: 1; min-height: 0; border: 1px solid var(--line); }"],
  "/test.js": ["text/javascript", `
import { editor } from "/editor.js";
import { blocks } from "/blocks.js";
const place = document.querySelector("#place");
window.heard = [];
addEventListener("securitypolicyviolation", ({ violatedDirective, sourceFile }) => heard.push(violatedDirective + " in " + sourceFile));
document.addEventListener("keydown", ({ key, target }) => place.contains(target) && heard.push("the page's own " + key));
window.open = (options) => { window.it = editor(place, { label: "Your script", onChange: (text) => { window.changed = text; }, ...options }); };
window.lay = (options) => { window.it = blocks(place, { onChange: (state, luau) => { window.changed = luau; }, ...options }); };
window.ready = true;`],
};

const server = http.createServer(({ url }, response) => {
  const [kind, text] = FILES[url] ?? (url === "/style.css" ? ["text/css", read("src/live/page/style.css")]
    : /^\/\w+\.js$/.test(url) ? ["text/javascript", read("target/editor", url)] : ["text/html", PAGE.replace("LANG", url.slice(1) || "en")]);
  response.writeHead(200, { "content-type": kind, "content-security-policy": POLICY });
  response.end(text);
});
await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });

/** A page with an editor or blocks on it, which may neither fail nor want more than the policy allows. */
async function onPage({ language = "en", size = [1280, 800], dark = false, touch = false } = {}, test) {
  const page = await browser.newPage({ viewport: { width: size[0], height: size[1] }, hasTouch: touch, colorScheme: dark ? "dark" : "light", reducedMotion: "reduce" });
  const failed = [];
  page.on("pageerror", (error) => failed.push(error.stack));
  page.on("console", (message) => message.type() === "error" && failed.push(message.text()));
  page.on("request", (request) => new URL(request.url()).hostname === "127.0.0.1" || failed.push(`asked for ${request.url()}`));
  await page.goto(`http://127.0.0.1:${server.address().port}/${language}`);
  await page.waitForFunction("window.ready");
  await test(page);
  assert.deepEqual([...failed, ...(await page.evaluate("heard"))].filter((one) => !/favicon/.test(one)), []);
  await page.close();
}

async function accessible(page) {
  await page.evaluate(axe);
  const violations = await page.evaluate("axe.run().then(({ violations }) => violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html, any }) => html.slice(0, 200) + (any[0]?.message ?? '')).join(' | ')}`))");
  assert.deepEqual(violations, []);
}

const picture = (page, name) => pictures && page.screenshot({ path: path.join(pictures, `${name}.png`) });
const content = (page) => page.getByRole("textbox", { name: "Your script" });
/** Takes an option that is offered: CodeMirror ignores Enter in the first 75 ms, so that nobody takes one by accident. */
async function take(page, name) {
  await page.getByRole("option", { name, exact: true }).waitFor();
  await page.waitForTimeout(150);
  await page.keyboard.press("Enter");
}
const changed = (page, wanted) => page.waitForFunction((text) => window.changed === text, wanted, { timeout: 5000 }).catch(async () => assert.equal(await page.evaluate("window.changed"), wanted));

const PROMISES = {
  async "each lesson from 1 to 6 is solved with blocks"() {
    assert.equal(LESSONS.length, 6);
    const lessons = fs.readdirSync(path.join(root, "behaviours/lessons"));
    for (const number of LESSONS) {
      const { luau } = generate(state(number));
      assert.deepEqual(marks(luau), [], luau);
      const name = lessons.find((lesson) => lesson.startsWith(number));
      const checked = JSON.parse(spawnSync(spykee, ["lesson", "check", script(luau), "--lesson", name, "--json"], { encoding: "utf8" }).stdout);
      assert.equal(checked.points, checked.max_points, `lesson ${number}: ${JSON.stringify(checked.scenarios)}\n${luau}`);
    }
  },

  "what the blocks make needs no block to be filled, and keeps its own names"() {
    const block = (type, fields, inputs, next) => ({ type: `easy_${type}`, id: type, fields, inputs, next: next && { block: next } });
    const not = { block: block("not", {}, {}) };
    const one = block("while", {}, { A0: { block: block("both", { A1: "and" }, { A0: { block: block("both", { A1: "or" }, {}) }, A2: not }) } },
      block("set", { A0: { id: "1" } }, { A1: { block: block("text", { A0: "a\"\\\n\u0007" }) } }, block("change", { A0: { id: "2" } })));
    const { luau, blockOfLine } = generate({ blocks: { blocks: [{ ...block("start"), next: { block: one } }, block("wait")] }, variables: [{ id: "1", name: "end" }, { id: "2", name: "Größe 1" }, { id: "3", name: "ゲーム" }] });
    assert.equal(luau.split("\n").slice(2).join("\n"), "local end2 = 0\nlocal Grosse_1 = 0\nlocal value = 0\n\nwhile (false or false) and not false do\n\teasy.wait(0.1)\nend\nend2 = \"a\\\"\\\\\\n\\u{0007}\"\nGrosse_1 += 0\n");
    assert.deepEqual(marks(luau), []);
    assert.deepEqual([6, 7, 8, 9, 10, 11].map((line) => blockOfLine.get(line)), [undefined, "while", "while", "while", "set", "change"]);
  },

  "typing, completion, indentation and leaving work by keyboard alone": () => onPage({}, async (page) => {
    await page.evaluate((entries) => window.open({ completions: entries }), completions());
    await page.locator("#before").focus();
    await page.keyboard.press("Tab");
    await page.keyboard.type("local e = require(\"@spykee/easy\")\n");
    await page.keyboard.type("e.forw");
    await page.getByText("Drives forwards for a time").waitFor();
    await take(page, "forward");
    await page.keyboard.type("2");
    await changed(page, "local e = require(\"@spykee/easy\")\ne.forward(2)");
    await page.keyboard.press("End");
    await page.keyboard.type("\nrobot.on(\"noi");
    await page.getByText("A sound exceeds the configured level").waitFor();
    await picture(page, "editor-completion");
    await take(page, "noise");
    await page.keyboard.press("End");
    await page.keyboard.press("ArrowLeft");
    await page.keyboard.type(", function()\nx += if a then 1 else 2 -- it\nif x then\nfoo({\n1,");
    await page.keyboard.press("ArrowDown");
    await page.keyboard.press("End");
    await page.keyboard.press("ArrowLeft");
    await page.keyboard.type("\nelse\nend\nend");
    await changed(page, "local e = require(\"@spykee/easy\")\ne.forward(2)\nrobot.on(\"noise\", function()\n\tx += if a then 1 else 2 -- it\n\tif x then\n\t\tfoo({\n\t\t\t1,\n\t\t})\n\telse\n\tend\nend)");
    await page.evaluate("it.setText('')");
    await page.keyboard.type("print(\"robot. -- \") -- robot.\nprint('a') rob");
    await take(page, "robot");
    await page.keyboard.type(".led");
    await page.keyboard.press("Enter");
    await page.keyboard.type("i");
    await page.keyboard.press("Enter");
    await changed(page, "print(\"robot. -- \") -- robot.\nprint('a') robot.led\ni\n");
    await page.keyboard.press("Tab");
    await page.keyboard.press("Escape");
    await page.keyboard.press("Tab");
    assert.equal(await page.evaluate("document.activeElement.id"), "after");
    await page.keyboard.press("Shift+Tab");
    assert.equal(await page.evaluate("it.element.shadowRoot.activeElement?.getAttribute('aria-description')"), "Tab indents. To leave the editor by keyboard: Escape, then Tab. F8 goes to the next mistake.");
  }),

  "marks say what is wrong and what to do": () => onPage({}, async (page) => {
    const text = "easy.wait(1)\nlocal ö = \"äöü😀\" .. robot.lod(\"left\", true)\n".replace("ö =", "o =");
    await page.evaluate((first) => window.open({ text: first, completions: [] }), text);
    await page.evaluate((list) => window.it.setMarks(list), marks(text));
    await content(page).focus();
    await page.getByRole("status").getByText("Line 1: unknown name 'easy' – if you mean the module").waitFor();
    assert.deepEqual(await page.locator(".cm-lintRange").allTextContents(), ["easy", "lod"]);
    await page.keyboard.press("ArrowDown");
    await page.getByRole("status").getByText("did you mean 'led'?").waitFor();
    await page.keyboard.press("Control+Home");
    await page.keyboard.press("F8");
    await page.keyboard.press("F8");
    await page.getByRole("status").getByText("Line 2: robot.lod does not exist; did you mean 'led'?").waitFor();
    await page.evaluate("it.setMarks([{ line: 99, column: 7, message: 'far away' }, { line: 1, column: 4000, end_column: 1, message: 'wide', severity: 'warning' }])");
    await accessible(page);
  }),

  "the page sets text, marks the line that runs, and may forbid to change it": () => onPage({}, async (page) => {
    await page.evaluate("open({ text: 'one', readOnly: true })");
    await content(page).focus();
    await page.keyboard.type("x");
    assert.equal(await page.evaluate("it.text"), "one");
    await page.evaluate("it.setText(Array.from({ length: 300 }, (_, n) => `print(${n})`).join('\\n')), it.highlightLine(250), it.showLine(250)");
    assert.equal(await page.locator(".cm-running").textContent(), "print(249)");
    for (const text of ["`-- 1\\n${it.text}`", "it.text.replace('print(0)', 'print(00)')", "`${it.text}\\n-- 2`"]) {
      await page.evaluate(`it.setText(${text})`);
      assert.equal(await page.locator(".cm-running").textContent(), "print(249)");
      assert.equal(await page.locator(".cm-activeLine").textContent(), "print(249)");
    }
    assert.match(await page.evaluate("it.text"), /^-- 1\nprint\(00\)\nprint\(1\)\n[^]*print\(299\)\n-- 2$/);
    await page.evaluate("it.setText('aa'), it.setText('aaa'), it.setText('a'), it.setText('')");
    assert.equal(await page.evaluate("it.text"), "");
    await page.evaluate("it.highlightLine(null), it.highlightLine(4000)");
    assert.equal(await page.locator(".cm-running").count(), 0);
    assert.equal(await page.evaluate("window.changed"), undefined);
    await accessible(page);
  }),

  async "the editor looks well and is accessible in each theme and on a tablet"() {
    const text = `${read("behaviours/lessons/06-seeing/solution.lua")}\nlocal text = \`{1} of 2\`\nwhile true do -- "for ever"\n\trobot.lod("left", 1.5e3)\nend\n`;
    for (const [name, size, dark] of [["editor-light", [1280, 800], false], ["editor-dark", [1280, 800], true], ["editor-tablet", [820, 1180], true]]) {
      await onPage({ size, dark }, async (page) => {
        await page.evaluate((first) => window.open({ text: first }), text);
        await page.evaluate((list) => (window.it.setMarks(list), window.it.highlightLine(7)), marks(text));
        await content(page).focus();
        await accessible(page);
        await picture(page, name);
      });
    }
  },

  async "Blockly reads the states of the lessons as they are"() {
    for (const lesson of LESSONS) {
      await onPage({}, async (page) => {
        await page.evaluate((saved) => window.lay({ state: saved }), state(lesson));
        assert.equal(await page.evaluate("it.luau"), generate(state(lesson)).luau);
      });
    }
  },

  "blocks are laid, changed and deleted by keyboard alone; a number stays in its range": () => onPage({}, async (page) => {
    const press = async (...keys) => {
      for (const key of keys) {
        await page.keyboard.press(key);
      }
    };
    const at = (label) => page.waitForFunction((words) => (document.activeElement.getAttribute("aria-label") ?? document.activeElement.tagName).startsWith(words), label, { timeout: 5000 }).catch(async () => assert.equal(await page.evaluate("document.activeElement.outerHTML"), label));
    const [nothing, drive] = ["local easy = require(\"@spykee/easy\")\n", (cm) => `${nothing}\neasy.drive(${cm})\n`];
    await page.evaluate("lay({})");
    await page.locator("#before").focus();
    await press("Tab", "ArrowDown", "ArrowRight");
    await at("drive, 40");
    await picture(page, "blocks-keyboard");
    await press("Enter");
    await page.locator(".blocklyDragging").first().waitFor();
    await press("ArrowDown");
    await page.locator(".blocklyInsertionMarker, .blocklyReplaceable").first().waitFor({ state: "attached" });
    await press("Enter");
    await changed(page, drive(40));
    await at("drive, 40");
    await press("ArrowRight");
    await at("Edit number: 40");
    await press("Enter");
    await at("drive 40 centimetres");
    await page.keyboard.type("5000");
    await accessible(page);
    await press("Enter");
    await changed(page, drive(1000));
    await at("Edit number: 1000");
    await press("ArrowLeft");
    await at("drive, 1000");
    await press("Delete");
    await changed(page, nothing);
    await press("t", "End");
    await page.getByRole("treeitem", { name: "Variables" }).click();
    await page.getByText("New variable").click();
    await accessible(page);
    await page.keyboard.type("Punkte");
    await picture(page, "blocks-variable");
    await press("Enter");
    await changed(page, `${nothing}\nlocal Punkte = 0\n`);
    await page.locator("#after").focus();
    await page.keyboard.press("Shift+Tab");
    assert.ok(await page.evaluate("it.element.contains(document.activeElement)"));
  }),

  async "a block is dragged by mouse and by finger"() {
    for (const touch of [false, true]) {
      await onPage({ size: [820, 1180], touch }, async (page) => {
        await page.evaluate("lay({})");
        await page.getByRole("treeitem", { name: "Lights" })[touch ? "tap" : "click"]();
        const [from, to] = [await page.getByText("play the sound").boundingBox(), await page.getByText("when the program starts").boundingBox()];
        const path = [[from.x + 4, from.y + 4], [from.x + 30, from.y + 30], [700, 300], [to.x + 8, to.y + 44], [to.x + 6, to.y + 40]];
        const client = await page.context().newCDPSession(page);
        for (const [index, [x, y]] of path.entries()) {
          if (touch) {
            await client.send("Input.dispatchTouchEvent", { type: index === 0 ? "touchStart" : "touchMove", touchPoints: [{ x, y }] });
          } else {
            await page.mouse.move(x, y);
            await (index === 0 && page.mouse.down());
          }
        }
        await (touch ? client.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] }) : page.mouse.up());
        await changed(page, "local easy = require(\"@spykee/easy\")\n\neasy.sound(\"bip_2\")\n");
        await page.locator(".blocklyDropdownField:not(.blocklyFlyout *)")[touch ? "tap" : "click"]();
        await page.getByRole("option", { name: "laugh" })[touch ? "tap" : "click"]();
        await changed(page, "local easy = require(\"@spykee/easy\")\n\neasy.sound(\"laugh\")\n");
      });
    }
  },

  async "the running line's block lights up; blocks look well and are accessible in each theme and on a tablet"() {
    for (const [name, language, size, dark] of [["blocks-light", "en", [1280, 800], false], ["blocks-dark", "de", [1280, 800], true], ["blocks-tablet", "it", [820, 1180], false]]) {
      await onPage({ language, size, dark }, async (page) => {
        await page.evaluate((saved) => window.lay({ state: saved }), state("06"));
        await page.evaluate("it.highlight(7)");
        assert.equal(await page.locator(".blocklyHighlighted").count(), 1);
        await accessible(page);
        await picture(page, name);
        await page.locator(".blocklyToolboxCategory").nth(1).click();
        await picture(page, `${name}-toolbox`);
        await page.evaluate("it.highlight(null)");
        assert.equal(await page.locator(".blocklyHighlighted").count(), 0);
        await page.evaluate("it.dispose()");
        assert.equal(await page.locator("#place > *").count(), 0);
        await page.evaluate("lay({ state: null })");
        assert.equal(await page.evaluate("getComputedStyle(document.querySelector('.blocklySvg')).position"), "absolute");
        assert.equal(await page.evaluate("it.luau"), generate().luau);
      });
    }
  },
};

let broken = 0;
for (const [promise, test] of Object.entries(PROMISES).filter(([name]) => name.includes(only))) {
  try {
    await test();
    console.log(`kept: ${promise}`);
  } catch (error) {
    broken += 1;
    console.log(`BROKEN: ${promise}\n  ${error.stack}`);
  }
}
await browser.close();
server.close();
fs.rmSync(work, { recursive: true });
console.log(broken === 0 ? `all promises are kept` : `${broken} broken`);
process.exit(Number(broken > 0));
