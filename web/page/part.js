// The page's compiled part: that of several threads where there can be some, or that of one, which has WebGPU.

import * as single from "./pkg/splitplane.js";
import * as shared from "./pkg/threads/splitplane_threads.js";
import { startPool, threadsHere, webWorker, whyNot } from "./pool.js";

const spawn = () => webWorker(new Worker(new URL("./thread.js", import.meta.url), { type: "module" }));

/** Why there is one thread; `null` where there can be more. */
function whyOne(isForGpu) {
    if (isForGpu) return "the compiled part with WebGPU has no more";
    if (threadsHere() === 1) return "this machine has one core";
    return shared.missing ?? whyNot();
}

/** Loads one of them: it, its memory, its number of threads, and why that is 1. `ended` is called with a text when a thread has ended. */
export async function loadPart(isForGpu, ended) {
    let why = whyOne(isForGpu);
    if (why === null) {
        try {
            const threads = threadsHere();
            const source = new URL("./pkg/threads/splitplane_threads_bg.wasm", import.meta.url);
            const { memory } = await startPool(shared, { threads, source, spawn, ended });
            return { raw: shared, memory, threads, why };
        } catch (error) {
            why = error.message ?? String(error);
        }
    }
    const { memory } = await single.default();
    return { raw: single, memory, threads: 1, why };
}
