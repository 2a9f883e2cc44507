// The package in Node, which fetches no files and has workers of its own.

import { readFile } from "node:fs/promises";
import { Worker } from "node:worker_threads";

import { init as start } from "./index.js";
import { options } from "./module.js";
import { initThreads as startThreads } from "./threads.js";

export * from "./index.js";

const file = (name) => readFile(new URL(`../pkg/${name}`, import.meta.url));

export async function init(source) {
    await start(source ?? (await file("splitplane_bg.wasm")));
}

function ownWorker() {
    const worker = new Worker(new URL("./threads-worker-node.js", import.meta.url));
    let isEnding = false;
    return {
        post: (told) => worker.postMessage(told),
        hear(message, failed) {
            worker.on("message", (told) => {
                // Threads that wait for work keep no program from its end.
                worker.unref();
                message(told);
            });
            worker.on("error", (error) => failed(error.message));
            worker.on("exit", (code) => isEnding || failed(`a worker has ended with status ${code}`));
        },
        end() {
            isEnding = true;
            worker.terminate();
        },
    };
}

export async function initThreads(given) {
    const known = options(given);
    // Where the part is not built, the error says so.
    const source = known.source ?? (await file("threads/splitplane_threads_bg.wasm").catch(() => undefined));
    return startThreads({ ...known, source }, ownWorker);
}
