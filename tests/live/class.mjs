// Measures a class of learners, some of them in Chromium, the others by script: see scripts/class.

import { spawn } from "node:child_process";
import fs from "node:fs";
import net from "node:net";
import { createRequire } from "node:module";
import os from "node:os";
import path from "node:path";
import { executablePath } from "./browser.mjs";

const [spykee, tools, learners, pages] = process.argv.slice(2);
const require = createRequire(path.join(tools, "/"));
const { chromium } = require("playwright-core");
const WebSocket = require("ws");
const LESSON = "03-moving";
const DRIVES = "local easy = require(\"@spykee/easy\")\nwhile true do\n\teasy.left(60)\n\teasy.right(60)\nend\n";
const WAIT_LIMIT = 60_000;
/** How long the load is measured. */
const LOAD = 20_000;
/** So many of thirty learners repeat an error: of fewer, a fifth. */
const STUCK = Math.max(1, Math.floor(learners / 5));
const folder = fs.mkdtempSync(path.join(os.tmpdir(), "spykee-class-"));
const rest = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

async function until(is, what) {
  for (const began = Date.now(); !(await is());) {
    if (Date.now() - began > WAIT_LIMIT) {
      throw new Error(`waited in vain for ${what}`);
    }
    await rest(10);
  }
}

/** What the class promises: each with its limit, in the order in which it was measured. */
const results = [];
function note(promise, measured, limit, unit) {
  results.push({ promise, kept: measured <= limit });
  console.log(`${measured <= limit ? "kept  " : "BROKEN"}  ${promise.padEnd(58)} ${measured.toFixed(2).padStart(8)} ${unit}, at most ${limit}`);
}

const percentile = (numbers, share) => [...numbers].sort((one, other) => one - other)[Math.min(numbers.length - 1, Math.ceil(numbers.length * share) - 1)];

/** The server, which says where it is. */
class Server {
  static async start() {
    const server = new Server();
    const free = net.createServer();
    await new Promise((resolve) => free.listen(0, "127.0.0.1", resolve));
    const { port } = free.address();
    await new Promise((resolve) => free.close(resolve));
    server.began = Date.now();
    server.process = spawn(spykee, ["class", path.join(folder, "class"), "--listen", `127.0.0.1:${port}`], { cwd: folder });
    let text = "";
    server.process.stdout.on("data", (data) => { text += data; });
    server.process.stderr.on("data", (data) => { text += data; });
    await until(() => /#token=\S+/.test(text) || server.process.exitCode !== null, "the class to open");
    server.base = /(http:\/\/\S+?)\/ /.exec(text)[1];
    server.word = /Class word: (.+)/.exec(text)[1];
    server.token = /#token=(\S+)/.exec(text)[1];
    return server;
  }

  /** Its process and those of the runs. */
  tree() {
    const parents = fs.readdirSync("/proc").filter((name) => /^\d+$/.test(name)).map((pid) => {
      try {
        return [Number(pid), Number(/\) \S (\d+)/.exec(fs.readFileSync(`/proc/${pid}/stat`, "utf8"))[1])];
      } catch {
        return [0, 0];
      }
    });
    const found = [this.process.pid];
    for (const pid of found) {
      found.push(...parents.filter(([, parent]) => parent === pid).map(([child]) => child));
    }
    return found;
  }

  /** Seconds of processor time, and MiB of memory, of all of them. */
  load() {
    const sum = { seconds: 0, mib: 0 };
    for (const pid of this.tree()) {
      try {
        const fields = fs.readFileSync(`/proc/${pid}/stat`, "utf8").replace(/.*\) /s, "").split(" ");
        sum.seconds += (Number(fields[11]) + Number(fields[12])) / 100;
        sum.mib += Number(/^Pss: +(\d+)/m.exec(fs.readFileSync(`/proc/${pid}/smaps_rollup`, "utf8"))[1]) / 1024;
      } catch {
        // It has just ended.
      }
    }
    return sum;
  }
}

/** Somebody with rights: a learner's device by its cookie, the teacher by the token. */
class Person {
  constructor(server, headers, name) {
    Object.assign(this, { server, name, headers: { ...headers, origin: server.base } });
  }

  async ask(where, body, method = body === undefined ? "GET" : "POST") {
    const answer = await fetch(`${this.server.base}/class/${where}`, {
      method, headers: { ...this.headers, "content-type": "application/json" }, body: body && JSON.stringify(body),
    });
    const said = await answer.json().catch(() => null);
    if (!answer.ok) {
      throw new Error(`${this.name}: ${method} ${where}: ${answer.status} ${JSON.stringify(said)}`);
    }
    return { ...said, cookie: answer.headers.get("set-cookie")?.split(";")[0] };
  }

  /** The newest state that the server sent. */
  async follow() {
    const socket = new WebSocket(`${this.server.base.replace("http", "ws")}/class/events`, { headers: this.headers });
    socket.on("message", (data) => {
      this.state = JSON.parse(data);
      this.heard?.(this.state);
    });
    socket.on("error", () => {});
    await until(() => this.state, `the state of ${this.name}`);
  }

  /** Looks at a run as a page does: the newest map, and frames that are confirmed. */
  async look(where = "live") {
    this.socket?.terminate();
    this.map = undefined;
    const socket = new WebSocket(`${this.server.base.replace("http", "ws")}/class/${where}`, { headers: this.headers });
    this.socket = socket;
    // A run that has just begun may not listen yet.
    socket.on("error", () => this.socket === socket && setTimeout(() => this.socket === socket && this.look(where), 50));
    socket.on("open", () => socket.send(JSON.stringify({ type: "watch", map: true, camera: true, log: true })));
    socket.on("message", (data, binary) => {
      if (binary) {
        this.frames = (this.frames ?? 0) + 1;
        return socket.send(JSON.stringify({ type: "frame_shown", number: data.readUInt32BE(0) }));
      }
      const message = JSON.parse(data);
      if (message.type === "map") {
        const moved = !this.map || message.robot.some((number, index) => Math.abs(number - this.map.robot[index]) > 0.002);
        this.movedAt = moved && this.map ? Date.now() : this.movedAt;
        this.map = message;
      }
    });
  }

  async write(text, where = "script") {
    const { version } = await this.ask(`${where}?lesson=${LESSON}`);
    await this.ask(`${where}?lesson=${LESSON}`, { text, version }, "PUT");
  }

  /** Writes and runs a script. Returns the seconds until the robot moves. */
  async run(text) {
    await this.write(text);
    const began = Date.now();
    await this.ask("run", { lesson: LESSON, speed: 1 });
    await this.look();
    await until(() => this.movedAt >= began, `${this.name}'s robot to move`);
    return (this.movedAt - began) / 1000;
  }
}

async function join(server, name) {
  const nobody = new Person(server, {}, name);
  const { cookie } = await nobody.ask("join", { word: server.word, name });
  return new Person(server, { cookie }, name);
}

/** Admits all who wait, as long as the class is open. */
async function admitAll(teacher) {
  const asked = new Set();
  await teacher.follow();
  const admit = ({ waiting }) => waiting.filter(({ id }) => !asked.has(id)).forEach(({ id }) => {
    asked.add(id);
    teacher.ask("admit", { id, admit: true }).catch((error) => console.log(error.message));
  });
  admit(teacher.state);
  teacher.heard = admit;
}

async function openPage(browser, server, name) {
  const page = await (await browser.newContext()).newPage();
  await page.goto(`${server.base}/#${server.word.replaceAll(" ", "-")}`);
  await page.locator("#name").fill(name);
  await page.keyboard.press("Enter");
  await page.locator("#lesson").selectOption(LESSON);
  return page;
}

/** Presses Run in a page. Returns when the robot has moved for the first time. */
async function pressRun(page, teacher) {
  await teacher.write(DRIVES, "of/page1/script");
  // In the editor, or in the plain field of a page without one.
  const inEditor = page.getByText("easy.right").first().waitFor();
  const inField = until(async () => (await page.locator("textarea").inputValue()).includes("easy.right"), "the text of page1");
  await Promise.any([inEditor, inField]);
  const began = Date.now();
  await page.locator("button.primary").click();
  await until(() => teacher.state.learners.find(({ name }) => name === "page1")?.run.running, "the run of page1");
  await teacher.look("of/page1/live");
  await until(() => teacher.movedAt >= began, "the robot of page1 to move");
  const { socket } = teacher;
  teacher.socket = null;
  socket.terminate();
  return teacher.movedAt;
}

/** Seconds until the wall shows an edit. */
async function editToWall(teacher, learner) {
  const edits = () => teacher.state.learners.find(({ name }) => name === learner.name).edits;
  const [before, { text, version }] = [edits(), await learner.ask(`script?lesson=${LESSON}`)];
  const began = Date.now();
  await learner.ask(`script?lesson=${LESSON}`, { text: `${text}-- ${began}\n`, version }, "PUT");
  await until(() => edits() > before, `the edit of ${learner.name} on the wall`);
  return (Date.now() - began) / 1000;
}

/** Some learners repeat an error, the others make different ones. Returns how many are flagged wrongly, or not. */
async function flags(teacher, clients) {
  const stuck = new Set(clients.slice(0, STUCK).map(({ name }) => name));
  const fails = async (learner, error) => {
    await learner.write(`error("${error}")\n`);
    const before = learner.state.run.number;
    await learner.ask("run", { lesson: LESSON });
    await until(() => learner.state.run.number > before && learner.state.run.error && !learner.state.run.running, `the error of ${learner.name}`);
  };
  await Promise.all(clients.map((learner) => learner.follow()));
  for (const time of ["once", "twice", "thrice"]) {
    await Promise.all(clients.map((learner, index) => fails(learner, stuck.has(learner.name) ? "no such call" : `${time} ${String.fromCharCode(97 + index)}`)));
  }
  const flagged = () => teacher.state.learners.filter((learner) => learner.flags.includes("same_error")).map(({ name }) => name);
  await until(() => flagged().length >= stuck.size, "the flags").catch(() => {});
  await rest(500);
  return { missed: [...stuck].filter((name) => !flagged().includes(name)).length, false: flagged().filter((name) => !stuck.has(name)).length };
}

async function measure() {
  const server = await Server.start();
  const teacher = new Person(server, { authorization: `Bearer ${server.token}` }, "teacher");
  await admitAll(teacher);
  const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
  const first = await openPage(browser, server, "page1");
  note("from the command to the first learner's moving robot", (await pressRun(first, teacher) - server.began) / 1000, 60, "s");
  const opened = [first];
  for (let number = 2; number <= Number(pages); number += 1) {
    opened.push(await openPage(browser, server, `page${number}`));
  }
  const clients = await Promise.all(Array.from({ length: learners - pages }, (_, number) => join(server, `client${number + 1}`)));
  await until(() => teacher.state.learners.filter(({ name }) => /^client/.test(name)).length === clients.length && teacher.state.waiting.length === 0, "all to be admitted");
  await Promise.all(clients.map((learner) => learner.follow()));

  // One after another, as people press Run; the last ones beside the load of all others.
  const starts = [];
  for (const learner of clients) {
    starts.push(await learner.run(DRIVES));
  }
  note("Run to the first movement, of 95 %", percentile(starts, 0.95), 1, "s");
  for (const page of opened.slice(1)) {
    await page.locator("button.primary").click();
  }
  const edits = [];
  for (const learner of clients) {
    edits.push(await editToWall(teacher, learner));
  }
  note("an edit to the wall, the slowest", Math.max(...edits), 1, "s");
  const [before, began] = [server.load(), Date.now()];
  const frames = () => clients.reduce((sum, { frames: seen }) => sum + seen, 0);
  const seen = frames();
  await rest(LOAD);
  const [after, took] = [server.load(), (Date.now() - began) / 1000];
  note("processors, server and workers", (after.seconds - before.seconds) / took, 1.5, "cores");
  note("memory, server and workers", after.mib / 1024, 1.5, "GiB");
  console.log(`        pictures that a client got: ${((frames() - seen) / took / clients.length).toFixed(1)} per second`);

  const frozen = Date.now();
  await teacher.ask("freeze", { on: true });
  await rest(2000);
  note("freeze to the last movement, the slowest", Math.max(...clients.map(({ movedAt }) => movedAt - frozen)) / 1000, 0.3, "s");
  await teacher.ask("freeze", { on: false });
  const thawed = Date.now();
  await until(() => clients.every(({ movedAt }) => movedAt > thawed), "all robots to go on");

  const wrong = await flags(teacher, clients);
  note("stuck learners that the wall does not flag", wrong.missed, 0, `of ${STUCK}`);
  note("others that it flags", wrong.false, 1, `of ${clients.length - STUCK}`);

  const text = `-- ${Date.now()}`;
  await first.getByRole("textbox").first().click();
  await first.keyboard.type(`\n${text}\n`);
  await rest(2000);
  const runs = server.tree().slice(1);
  server.process.kill("SIGKILL");
  const file = fs.readFileSync(path.join(folder, "class", "page1", `${LESSON}.lua`), "utf8");
  note("what was typed 2 s before kill -9 and is lost", Number(!file.includes(text)), 0, "texts");
  await rest(3000);
  note("runs that outlive the server", runs.filter((pid) => fs.existsSync(`/proc/${pid}`)).length, 0, `of ${runs.length}`);
  await browser.close();
}

await measure();
fs.rmSync(folder, { recursive: true });
process.exit(Number(results.some(({ kept }) => !kept)));
