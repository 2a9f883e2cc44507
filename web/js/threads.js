// The package on several threads: a compiled part of its own.

import { SplitplaneError } from "./error.js";
import { count, crash, number, options, startWith } from "./module.js";
import { LEAST_MEMORY, MOST_MEMORY, MOST_THREADS, startPool, threadsHere, webWorker, whyNot } from "./pool.js";

function ownWorker() {
    return webWorker(new Worker(new URL("./threads-worker.js", import.meta.url), { type: "module" }));
}

/** Where the compiled part is if nothing else is said. */
const beside = () => new URL("../pkg/threads/splitplane_threads_bg.wasm", import.meta.url);

async function load(settings) {
    let raw;
    try {
        raw = await import("../pkg/threads/splitplane_threads.js");
    } catch (error) {
        throw new SplitplaneError("not-ready", `the compiled part for threads cannot be loaded: ${error.message ?? error}`, { cause: error });
    }
    // Where it could not be built, its place says why.
    if (raw.missing !== undefined) throw new SplitplaneError("threads", `there are no threads: ${raw.missing}`);
    return { raw, ...(await startPool(raw, settings)) };
}

/** As `init`, with threads; see index.d.ts. `spawn` starts a worker. */
export async function initThreads(given, spawn = ownWorker) {
    const { threads = threadsHere(), source = beside(), maxMemory } = options(given);
    if (count(threads, "threads", MOST_THREADS) === 0) throw new SplitplaneError("config", `threads is 0, but must be 1 to ${MOST_THREADS}`);
    if (maxMemory !== undefined && !(number(maxMemory, "maxMemory") >= LEAST_MEMORY && maxMemory <= MOST_MEMORY)) {
        throw new SplitplaneError("config", `maxMemory is ${maxMemory}, but must be ${LEAST_MEMORY} to ${MOST_MEMORY} bytes`);
    }
    const why = whyNot();
    if (why !== null) throw new SplitplaneError("threads", `there are no threads: ${why}`);
    const ended = (text) => crash(`a thread of the compiled part has ended (${text})`);
    await startWith(() => load({ threads, source, maxMemory, spawn, ended }));
    return threads;
}
