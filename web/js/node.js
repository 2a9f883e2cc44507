// The package in Node, which fetches no files.

import { readFile } from "node:fs/promises";

import { init as start } from "./index.js";

export * from "./index.js";

export async function init(source) {
    await start(source ?? (await readFile(new URL("../pkg/splitplane_bg.wasm", import.meta.url))));
}
