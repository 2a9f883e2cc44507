// The page's compiled part: that of several threads where there can be some, or that of one, which has WebGPU.

import { MOST_MEMORY, startPool, threadsHere, webWorker, whyNot } from "./pool.js";

/** With less shared memory than this, in bytes, the part of one thread is the better one: its memory grows as long as there is some. */
const ENOUGH = 2 ** 30;

const spawn = () => webWorker(new Worker(new URL("./thread.js", import.meta.url), { type: "module" }));

/** The part of several threads, on as many as there are cores. */
async function loadShared(ended) {
    const raw = await import("./pkg/threads/splitplane_threads.js");
    // Where it could not be built, its place says why.
    if (raw.missing !== undefined) throw new Error(raw.missing);
    const threads = threadsHere();
    const source = new URL("./pkg/threads/splitplane_threads_bg.wasm", import.meta.url);
    const { memory, most } = await startPool(raw, { threads, source, least: ENOUGH, spawn, ended });
    return { raw, memory, mostMemory: most, threads, why: null };
}

/**
 * Loads one of them: it, its memory and the most bytes of that, its number of threads, and why that is 1. `ended` is called with a text when a thread has ended before its
 * time.
 */
export async function loadPart(isForGpu, ended) {
    let why = isForGpu ? "the compiled part with WebGPU has no more" : threadsHere() === 1 ? "this machine has one core" : whyNot();
    if (why === null) {
        try {
            return await loadShared(ended);
        } catch (error) {
            why = error.message ?? String(error);
        }
    }
    const raw = await import("./pkg/splitplane.js");
    const { memory } = await raw.default();
    return { raw, memory, mostMemory: MOST_MEMORY, threads: 1, why };
}
