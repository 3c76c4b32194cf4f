// The browser of all tests of pages: `$CHROMIUM`, or else Chromium without its windows, if that is installed:
// it shows the same pages in about half the processor time. At night it is the whole browser, as people have it.

import fs from "node:fs";
import path from "node:path";

const folders = process.env.PATH.split(":");
const names = process.env.NIGHTLY ? ["chromium"] : ["chromium-headless-shell", "chromium"];
const installed = names.flatMap((name) => folders.map((folder) => path.join(folder, name)));
export const executablePath = process.env.CHROMIUM || installed.find((file) => fs.existsSync(file));
