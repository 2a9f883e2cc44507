// The package in Node, which fetches no files and has workers of its own.

import { readFile } from "node:fs/promises";
import { availableParallelism } from "node:os";

import { init as start } from "./index.js";
import { options } from "./module.js";
import { MOST_THREADS } from "./pool.js";
import { nodeWorker } from "./pool-node.js";
import { initThreads as startThreads } from "./threads.js";

export * from "./index.js";

const file = (name) => readFile(new URL(`../pkg/${name}`, import.meta.url));

export async function init(source) {
    await start(source ?? (await file("splitplane_bg.wasm")));
}

export async function initThreads(given) {
    // Before version 21 Node has no `navigator`, which tells browsers how many cores there are.
    const { threads = Math.min(MOST_THREADS, availableParallelism()), ...known } = options(given);
    // Where the part is not built, the error says so.
    const source = known.source ?? (await file("threads/splitplane_threads_bg.wasm").catch(() => undefined));
    return startThreads({ ...known, threads, source }, () => nodeWorker(new URL("./threads-worker-node.js", import.meta.url)));
}
