// The package in a browser, a worker or a bundler; Node starts at node.js.

import { call, isReady, raw, start } from "./module.js";
import { initThreads as startThreads } from "./threads.js";

export { BACKENDS, Backend } from "./backend.js";
export { ACCURACIES, CULLINGS, NONE } from "./batch.js";
export { CODES, SplitplaneError } from "./error.js";
export { Gpu, GpuTree } from "./gpu.js";
export { GpuScene } from "./gpu-scene.js";
export { WasmArray } from "./module.js";
export { whyNot as whyNoThreads } from "./pool.js";
export { Scene } from "./scene.js";
export { Tree } from "./tree.js";
export { isReady };

export async function init(source) {
    await start(source);
}

/** As `init`, on several threads. */
export function initThreads(given) {
    return startThreads(given);
}

/** The package's version, the instruction set of its queries, and the number of threads. */
export function about() {
    return call(() => ({ version: raw.version(), instructionSet: raw.instructionSet(), threads: raw.threadCount?.() ?? 1 }));
}
