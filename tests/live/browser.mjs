// The browser of all tests of pages: `$CHROMIUM`, or else Chromium without its windows, if that is installed:
// it shows the same pages in about half the processor time.

import fs from "node:fs";
import path from "node:path";

const folders = process.env.PATH.split(":");
const installed = ["chromium-headless-shell", "chromium"].flatMap((name) => folders.map((folder) => path.join(folder, name)));
export const executablePath = process.env.CHROMIUM || installed.find((file) => fs.existsSync(file));
