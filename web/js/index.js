// The package in a browser, a worker or a bundler; Node starts at node.js.

import { call, isReady, raw, start } from "./module.js";

export { BACKENDS, Backend } from "./backend.js";
export { ACCURACIES, CULLINGS, NONE } from "./batch.js";
export { CODES, SplitplaneError } from "./error.js";
export { Gpu, GpuTree } from "./gpu.js";
export { GpuScene } from "./gpu-scene.js";
export { WasmArray } from "./module.js";
export { Scene } from "./scene.js";
export { Tree } from "./tree.js";
export { isReady };

export async function init(source) {
    await start(source);
}

/** The package's version and the instruction set of its queries. */
export function about() {
    return call(() => ({ version: raw.version(), instructionSet: raw.instructionSet() }));
}
