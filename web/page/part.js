// The page's compiled part: that of several threads where there can be some, or that of one, which has WebGPU.

import { startPool, threadsHere, webWorker, whyNot } from "./pool.js";

const spawn = () => webWorker(new Worker(new URL("./thread.js", import.meta.url), { type: "module" }));

/** The part of several threads, on as many as there are cores. */
async function loadShared(ended) {
    const raw = await import("./pkg/threads/splitplane_threads.js");
    // Where it could not be built, its place says why.
    if (raw.missing !== undefined) throw new Error(raw.missing);
    const threads = threadsHere();
    const source = new URL("./pkg/threads/splitplane_threads_bg.wasm", import.meta.url);
    const { memory } = await startPool(raw, { threads, source, spawn, ended });
    return { raw, memory, threads, why: null };
}

/**
 * Loads one of them: it, its memory, its number of threads, and why that is 1. `ended` is called with a text when a thread has ended before its
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
    return { raw, memory, threads: 1, why };
}
