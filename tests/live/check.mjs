// Drives the page in Chromium. Each promise is a function; what the robot does is asked of the simulated
// world, through the map's own messages.

import { spawn } from "node:child_process";
import fs from "node:fs";
import { createRequire } from "node:module";
import os from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

const [spykee, tools, pictures] = process.argv.slice(2);
const require = createRequire(path.join(tools, "/"));
const { chromium } = require("playwright-core");
const WebSocket = require("ws");
const axe = fs.readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
const root = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
const PATIENCE = 30_000;

/** A run with a page, in a folder of its own. */
class Run {
  static async start(files, args) {
    const run = new Run();
    run.folder = fs.mkdtempSync(path.join(os.tmpdir(), "spykee-live-"));
    for (const [name, text] of Object.entries(files)) {
      fs.writeFileSync(path.join(run.folder, name), text, { mode: 0o600 });
    }
    run.child = spawn(spykee, ["run", ...args, "--live=127.0.0.1:0"], { cwd: run.folder });
    run.text = "";
    run.child.stderr.on("data", (data) => { run.text += data; });
    run.child.stdout.on("data", (data) => { run.text += data; });
    await until(() => /the page is at (http\S+)/.test(run.text), "the page's address", () => run.text);
    run.url = /the page is at (http\S+)/.exec(run.text)[1];
    return run;
  }

  async end() {
    this.child.kill("SIGINT");
    await new Promise((resolve) => this.child.once("exit", resolve));
    fs.rmSync(this.folder, { recursive: true });
  }
}

async function until(is, what, context = () => "") {
  const began = Date.now();
  while (!(await is())) {
    if (Date.now() - began > PATIENCE) {
      throw new Error(`waited in vain for ${what} ${context()}`);
    }
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

/** A second pair of eyes: what the simulated world says, beside the page. */
class Witness {
  constructor(url) {
    this.socket = new WebSocket(`${url.replace("http", "ws")}live`);
    this.socket.onopen = () => this.socket.send(JSON.stringify({ type: "watch", map: true }));
    this.socket.onmessage = ({ data }) => {
      const message = JSON.parse(data);
      this[message.type] = message;
    };
  }

  async moves(does) {
    const moving = () => this.state && this.state.tracks.some((power) => power !== 0);
    await until(() => this.state && moving() === does, does ? "motion" : "a robot at rest");
  }

  async goes() {
    await until(() => this.map, "the map");
    const [x, y] = this.map.robot;
    await until(() => Math.hypot(this.map.robot[0] - x, this.map.robot[1] - y) > 0.05, "a robot that goes");
  }

  async rests() {
    await this.moves(false);
    const before = this.map.robot.join();
    await new Promise((resolve) => setTimeout(resolve, 700));
    const settled = this.map.robot.join();
    await new Promise((resolve) => setTimeout(resolve, 700));
    if (this.map.robot.join() !== settled) {
      throw new Error(`it moves on: ${before} ${settled} ${this.map.robot}`);
    }
  }

  close() {
    this.socket.close();
  }
}

const button = (page, name) => page.getByRole("button", { name, exact: true });
const IDLE = "log.info('I am idle')\ntask.wait(3600)\n";
const DESK = { viewport: { width: 1440, height: 1000 } };
const PHONE = { viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true };

async function open(browser, run, options = DESK) {
  const context = await browser.newContext({ locale: "en-GB", ...options });
  const page = await context.newPage();
  page.mistakes = [];
  page.on("pageerror", (error) => page.mistakes.push(error.message));
  page.on("console", (message) => message.type() === "error" && page.mistakes.push(message.text()));
  await page.goto(run.url);
  return page;
}

async function ready(page) {
  await page.getByRole("img", { name: "What the robot's camera sees" }).waitFor({ timeout: PATIENCE });
}

function clean(page) {
  if (page.mistakes.length > 0) {
    throw new Error(`the page complains: ${page.mistakes.join("; ")}`);
  }
}

const promises = {
  async "keys drive, letting go stops, and so does every loss"(browser) {
    const run = await Run.start({ "idle.lua": IDLE }, ["idle.lua", "--sim"]);
    const witness = new Witness(run.url);
    let page = await open(browser, run);
    await ready(page);
    const take = async () => {
      await button(page, "Take the wheel").click();
      await button(page, "Leave the wheel").waitFor();
      await page.evaluate(() => document.activeElement.blur());
    };
    await take();
    await page.keyboard.down("KeyD");
    await witness.moves(true);
    await page.keyboard.up("KeyD");
    await witness.rests();
    await page.keyboard.down("ArrowUp");
    await witness.goes();
    await page.keyboard.up("ArrowUp");
    await witness.rests();
    // The arrows of the page, held by the mouse.
    await button(page, "Right").hover();
    await page.mouse.down();
    await witness.moves(true);
    await page.mouse.up();
    await witness.rests();
    // The pad.
    const pad = await page.getByRole("img", { name: /Drive pad/ }).boundingBox();
    await page.mouse.move(pad.x + pad.width / 2, pad.y + pad.height / 2);
    await page.mouse.down();
    await page.mouse.move(pad.x + pad.width / 2 + 50, pad.y + pad.height / 2);
    await witness.moves(true);
    await page.mouse.up();
    await witness.rests();
    // Escape is STOP, wherever the keyboard is.
    await page.keyboard.down("KeyA");
    await witness.moves(true);
    await page.getByLabel("Your name").focus();
    await page.keyboard.press("Escape");
    await witness.rests();
    await page.keyboard.up("KeyA");
    await page.getByRole("alert").getByText(/Stopped/).waitFor();
    await button(page, "Let it move again").click();
    await until(() => !witness.state.halted, "a robot that may move");
    // A hidden page.
    await take();
    await page.keyboard.down("KeyA");
    await witness.moves(true);
    await page.evaluate(() => {
      Object.defineProperty(document, "hidden", { value: true, configurable: true });
      document.dispatchEvent(new Event("visibilitychange"));
    });
    await witness.rests();
    await until(() => witness.state.driver === null, "nobody at the wheel");
    clean(page);
    await page.close();
    // A closed page.
    page = await open(browser, run);
    await ready(page);
    await take();
    await page.keyboard.down("KeyA");
    await witness.moves(true);
    await page.close();
    await witness.rests();
    witness.close();
    await run.end();
  },

  async "STOP holds a behaviour that drives, and every control does what it says"(browser) {
    const drive = "while true do robot.move(30, -30, 0.4) log.info('round') end\n";
    const run = await Run.start({ "spin.lua": drive }, ["spin.lua", "--sim"]);
    const witness = new Witness(run.url);
    const page = await open(browser, run);
    await ready(page);
    await witness.moves(true);
    await button(page, "STOP").click();
    await witness.rests();
    await button(page, "Let it move again").click();
    await witness.moves(true);
    await button(page, "End spin").click();
    await witness.rests();
    await button(page, "Start spin").click();
    await witness.moves(true);
    await button(page, "End spin").click();
    await witness.rests();
    for (const light of ["Headlight", "Left light", "Right light"]) {
      await button(page, light).click();
    }
    await until(() => witness.state.lights.every((on) => on), "three lights");
    await page.getByLabel("Sound", { exact: true }).selectOption("laser");
    await button(page, "Play").click();
    await until(() => witness.state.sound === "laser", "a sound");
    await page.getByRole("slider", { name: "Battery level" }).fill("64");
    await until(() => witness.map.battery < 66 && witness.map.battery > 60, "another battery level");
    await page.getByLabel("x, metres").fill("2");
    await page.getByLabel("y, metres").fill("1.5");
    await button(page, "Put there").click();
    await until(() => Math.hypot(witness.map.robot[0] - 2, witness.map.robot[1] - 1.5) < 0.05, "a robot that was carried");
    // By dragging, too.
    const map = page.getByRole("img", { name: /^Map of/ });
    await page.evaluate(() => scrollTo(0, 0));
    const box = await map.boundingBox();
    const scale = box.width / (witness.world.width + 0.5);
    const at = (x, y) => [box.x + (x + 0.25) * scale, box.y + (witness.world.depth - y + 0.25) * scale];
    await page.mouse.move(...at(2, 1.5));
    await page.mouse.down();
    await page.mouse.move(...at(2.5, 2), { steps: 4 });
    await page.mouse.up();
    await until(() => Math.hypot(witness.map.robot[0] - 2.5, witness.map.robot[1] - 2) < 0.15, "a robot that was dragged");
    await page.getByLabel("Fault").selectOption("drop");
    await button(page, "Begin").click();
    await page.getByText(/disconnected/).first().waitFor();
    await page.getByText("Free to move").waitFor();
    // A line of the log leads to the script.
    await button(page, "spin:1").first().click();
    await page.locator("dialog .marked").getByText("while true do").waitFor();
    await button(page, "Close").click();
    await button(page, "Go to the station").click();
    await until(() => witness.state.docked, "a docked robot");
    await page.getByText("It is on its station").waitFor();
    await button(page, "Leave the station").click();
    await until(() => !witness.state.docked, "a robot that has left");
    clean(page);
    await page.context().close();
    witness.close();
    await run.end();
  },

  async "logging in and out, and roles"(browser) {
    const config = "live: { driver_password_file: driver, viewer_password_file: viewer }\n";
    const files = { "idle.lua": IDLE, "spykee.yaml": config, driver: "a good password\n", viewer: "only to look\n" };
    const run = await Run.start(files, ["idle.lua", "--sim", "--config", "spykee.yaml"]);
    const page = await open(browser, run);
    await page.getByLabel("Password or token").fill("wrong one");
    await button(page, "Log in").click();
    await page.getByText("that is not the password").waitFor();
    await keep(page, "login");
    await page.getByLabel("Password or token").fill("only to look");
    await button(page, "Log in").click();
    await ready(page);
    await page.getByText("You may look").waitFor();
    if (await button(page, "Take the wheel").isVisible()) {
      throw new Error("a viewer sees the wheel");
    }
    await button(page, "STOP").click();
    await page.getByText(/Nothing moves the robot/).waitFor();
    await button(page, "Log out").click();
    await page.getByLabel("Password or token").fill("a good password");
    await button(page, "Log in").click();
    await button(page, "Let it move again").click();
    await page.getByText("Free to move").waitFor();
    const cookies = await page.context().cookies();
    if (!cookies.every((one) => one.httpOnly && one.sameSite === "Strict")) {
      throw new Error(`a cookie that others can have: ${JSON.stringify(cookies)}`);
    }
    await page.context().close();
    await run.end();
  },

  async "what scripts say stays text"(browser) {
    const hostile = "log.warn('<img src=x onerror=\"document.title=1\"><b>bold</b>')\n"
      + "print('</script><script>document.body.remove()</script>')\nerror('<i>gone</i>')\n";
    const run = await Run.start({ "hostile.lua": hostile }, ["hostile.lua", "--sim", "--no-check"]);
    const page = await open(browser, run);
    await ready(page);
    await page.getByText("<b>bold</b>").first().waitFor();
    await page.getByText("<i>gone</i>").first().waitFor();
    await button(page, "Show line 3 of hostile").first().click();
    await page.locator("dialog .marked").getByText("<i>gone</i>").waitFor();
    const strangers = await page.locator("b, i, body script, img[src=x]").count();
    if (strangers > 0) {
      throw new Error(`${strangers} elements that a script has made`);
    }
    clean(page);
    await page.context().close();
    await run.end();
  },

  async "nothing serious in the way of people who use other means, in light and dark, large and small"(browser) {
    const run = await Run.start({}, [path.join(root, "behaviours/patrol.lua"), "--sim"]);
    for (const [name, options] of [["desktop", DESK], ["phone", PHONE]]) {
      for (const colorScheme of ["light", "dark"]) {
        const page = await open(browser, run, { ...options, colorScheme });
        await ready(page);
        await page.getByText(/patrol:\d+/).first().waitFor();
        await page.waitForTimeout(6000);
        // Only here: the page's own policy lets nothing in.
        const found = await page.evaluate(async (source) => {
          (0, eval)(source);
          return (await window.axe.run()).violations;
        }, axe).catch(async () => {
          const session = await page.context().newCDPSession(page);
          await session.send("Page.setBypassCSP", { enabled: true });
          await session.send("Runtime.evaluate", { expression: axe });
          return page.evaluate(async () => (await window.axe.run()).violations);
        });
        const serious = found.filter(({ impact }) => impact === "serious" || impact === "critical");
        if (serious.length > 0) {
          const words = serious.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html).join(" ").slice(0, 400)}`);
          throw new Error(`${name} ${colorScheme}: ${words.join("\n")}`);
        }
        const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
        if (wide > 0) {
          throw new Error(`${name}: ${wide} pixels too wide`);
        }
        await keep(page, `${name}-${colorScheme}`);
        clean(page);
        await page.context().close();
      }
    }
    await run.end();
  },

  async "the page speaks German and Italian"(browser) {
    const run = await Run.start({ "idle.lua": IDLE }, ["idle.lua", "--sim"]);
    for (const [locale, words] of [["de-DE", "Ans Steuer"], ["it-IT", "Prendi il volante"]]) {
      const page = await open(browser, run, { ...DESK, locale });
      await button(page, words).waitFor();
      await page.context().close();
    }
    await run.end();
  },
};

async function keep(page, name) {
  if (pictures) {
    fs.mkdirSync(pictures, { recursive: true });
    await page.screenshot({ path: path.join(pictures, `${name}.png`) });
  }
}

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox"],
});
let broken = 0;
for (const [promise, holds] of Object.entries(promises)) {
  const began = Date.now();
  try {
    await holds(browser);
    console.log(`ok      ${promise} (${((Date.now() - began) / 1000).toFixed(1)} s)`);
  } catch (error) {
    broken += 1;
    console.log(`BROKEN  ${promise}\n        ${error.stack}`);
  }
}
await browser.close();
process.exit(broken > 0 ? 1 : 0);
