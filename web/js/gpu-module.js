// The compiled part for WebGPU: loading it, calling it, and arrays in its memory.

import { SplitplaneError } from "./error.js";
import { WasmArray, refuseEnded } from "./module.js";

/** A promise of the compiled part, { raw, memory }, once it is asked for. After a crash there is no other. */
let loading = null;
let crashed = null;

/** Whether it has ended: there is nothing to be freed then. */
export const hasCrashed = () => crashed !== null;

/** The compiled part, loaded once. */
export function part(source) {
    loading ??= load(source);
    return loading;
}

/** What rejects the promises that are not settled. */
const unsettled = new Set();

function crash(message, cause) {
    const text = `the compiled part for WebGPU has ended (${message}); load the page, or start the worker, anew`;
    crashed ??= new SplitplaneError("crashed", text, { cause });
    for (const reject of [...unsettled]) reject(crashed);
}

/** Whether an error is a trap of the compiled part: one in the middle of a promise is told to nobody else. */
function isTrap(error) {
    return error instanceof WebAssembly.RuntimeError && /splitplane_gpu/.test(String(error.stack));
}

function listen() {
    const hear = ({ error, reason }) => {
        const trap = error ?? reason;
        if (isTrap(trap)) crash(trap.message, trap);
    };
    for (const name of ["error", "unhandledrejection"]) globalThis.addEventListener?.(name, hear);
}

async function load(source) {
    try {
        const raw = await import("../pkg/gpu/splitplane_gpu.js");
        const { memory } = await raw.default(source === undefined ? undefined : { module_or_path: source });
        raw.afterCrash((message) => crash(message));
        listen();
        return { raw, memory };
    } catch (error) {
        loading = null;
        throw new SplitplaneError("not-ready", `the compiled part for WebGPU cannot be loaded: ${error.message ?? error}`, { cause: error });
    }
}

/** An error of the compiled part as one of ours. */
function ours(error) {
    if (error instanceof SplitplaneError) return error;
    if (typeof error?.code === "string") return new SplitplaneError(error.code, error.message);
    if (error instanceof WebAssembly.RuntimeError || error instanceof RangeError) {
        crash(error.message, error);
        return crashed;
    }
    return error;
}

export function call(work) {
    if (crashed !== null) throw new SplitplaneError("crashed", crashed.message, { cause: crashed.cause });
    try {
        return work();
    } catch (error) {
        throw ours(error);
    }
}

/** What a promise of the compiled part gives, or the end of that part. */
export async function settled(work) {
    let reject;
    const ended = new Promise((_, no) => (reject = no));
    // Nobody need hear of it where the work comes first.
    ended.catch(() => {});
    unsettled.add(reject);
    try {
        return await Promise.race([call(work), ended]);
    } catch (error) {
        throw ours(error);
    } finally {
        unsettled.delete(reject);
    }
}

/** A copy of an array in the memory of the part for WebGPU, which it is handed over to. */
function moved({ raw, memory }, { value, what, type, each, optional }) {
    if (optional && (value === undefined || value === null)) value = new type(0);
    if (!(value instanceof type) && !(value instanceof WasmArray)) {
        const name = value === null ? "null" : (value?.constructor?.name ?? typeof value);
        throw new SplitplaneError("type", `${what} must be a ${type.name} or a WasmArray, but is ${name}`);
    }
    if (!(value instanceof WasmArray)) refuseEnded(value, what);
    if (value.length % each !== 0) {
        throw new SplitplaneError("shape", `${what}: the length is ${value.length}, but must be a multiple of ${each}`);
    }
    const words = call(() => new raw.Words(value.length));
    const from = value instanceof WasmArray ? value.words : new Uint32Array(value.buffer, value.byteOffset, value.length);
    new Uint32Array(memory.buffer, words.pointer(), value.length).set(from);
    return words;
}

/** Several of them; all are freed where one is refused. */
export function movedAll(part, given) {
    const made = [];
    try {
        for (const one of given) made.push(moved(part, one));
        return made;
    } catch (error) {
        for (const words of made) words.free();
        throw error;
    }
}
