// WebGPU: a compiled part of its own, with memory of its own, which is loaded when it is first asked for.

import { queryOptions, room } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { buildOptions, meshArrays } from "./mesh.js";
import { WasmArray, number, options, watcher } from "./module.js";
import { column } from "./queries.js";
import { SUMMARY } from "./tree.js";

/** A promise of the compiled part, { raw, memory }, once it is asked for. After a crash there is no other. */
let loading = null;
let crashed = null;
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

function call(work) {
    if (crashed !== null) throw new SplitplaneError("crashed", crashed.message, { cause: crashed.cause });
    try {
        return work();
    } catch (error) {
        throw ours(error);
    }
}

/** What a promise of the compiled part gives, or the end of that part. */
async function settled(work) {
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
    if (value.length % each !== 0) {
        throw new SplitplaneError("shape", `${what}: the length is ${value.length}, but must be a multiple of ${each}`);
    }
    const words = call(() => new raw.Words(value.length));
    const from = value instanceof WasmArray ? value.words : new Uint32Array(value.buffer, value.byteOffset, value.length);
    new Uint32Array(memory.buffer, words.pointer(), value.length).set(from);
    return words;
}

/** Several of them; all are freed where one is refused. */
function movedAll(part, given) {
    const made = [];
    try {
        for (const one of given) made.push(moved(part, one));
        return made;
    } catch (error) {
        for (const words of made) words.free();
        throw error;
    }
}

const RAYS = { what: "rays", type: Float32Array, each: 8 };

/** A tree on a GPU; see index.d.ts. */
export class GpuTree {
    #own;
    #part;

    constructor(own, part) {
        if (part === undefined || !(own instanceof part.raw.GpuTree)) throw new SplitplaneError("type", "a GpuTree is made by Gpu.build");
        this.#own = own;
        this.#part = part;
    }

    #alive() {
        if (this.#own === null) throw new SplitplaneError("freed", "this GpuTree was freed");
        return this.#own;
    }

    get digest() {
        return call(() => this.#alive().digest());
    }

    get summary() {
        const numbers = call(() => this.#alive().summary());
        return Object.fromEntries(SUMMARY.map((name, place) => [name, numbers[place]]));
    }

    get bounds() {
        const corners = call(() => this.#alive().bounds());
        return { min: corners.slice(0, 3), max: corners.slice(3) };
    }

    toBytes(positions, indices) {
        const own = this.#alive();
        const { isIndexed, arrays } = meshArrays(positions, indices);
        const made = movedAll(this.#part, arrays);
        try {
            return call(() => own.toBytes(...made, isIndexed));
        } finally {
            if (crashed === null) for (const words of made) words.free();
        }
    }

    /** Asks, and hands what comes back, as bytes, to `give`. */
    async #ask(name, rays, given, answerWords, give) {
        const own = this.#alive();
        const known = options(given);
        const { accuracy, culling, ignore, into } = queryOptions(known);
        const watch = watcher(known);
        watch.begin();
        const total = (rays?.length ?? 0) / 8;
        if (into !== undefined) room(into, rays, answerWords(total), "the answers");
        const [asked] = movedAll(this.#part, [{ ...RAYS, value: rays }]);
        const words = await watch.later(() => settled(() => own[name](asked, accuracy, culling, ignore, watch.called)));
        try {
            const found = new Uint32Array(this.#part.memory.buffer, words.pointer(), words.length());
            if (into === undefined) return give(found, total);
            into.words.set(found);
            return into;
        } finally {
            words.free();
        }
    }

    closestHitsAsync(rays, given) {
        return this.#ask("closestHits", rays, given, (total) => 4 * total, (words, total) => {
            const floats = new Float32Array(words.buffer, words.byteOffset, words.length);
            return {
                t: column(floats, total, 4, 0, Float32Array),
                triangle: column(words, total, 4, 1, Uint32Array),
                u: column(floats, total, 4, 2, Float32Array),
                v: column(floats, total, 4, 3, Float32Array),
            };
        });
    }

    anyHitsAsync(rays, given) {
        return this.#ask("anyHits", rays, given, (total) => Math.ceil(total / 4), (words, total) =>
            new Uint8Array(words.buffer, words.byteOffset, total).slice(),
        );
    }

    free() {
        if (this.#own !== null) {
            if (crashed === null) this.#own.free();
            this.#own = null;
        }
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}

/** A browser's GPU; see index.d.ts. */
export class Gpu {
    #own;
    #part;

    constructor(own, part) {
        if (part === undefined || !(own instanceof part.raw.Gpu)) throw new SplitplaneError("type", "a Gpu is made by Gpu.open");
        this.#own = own;
        this.#part = part;
    }

    static async open(given) {
        const { timeout, source, hardware = false, signal } = options(given);
        if (timeout !== undefined && !(number(timeout, "timeout") >= 0)) {
            throw new SplitplaneError("config", `timeout is ${timeout}, but must be 0 seconds or more`);
        }
        const watch = watcher({ signal });
        watch.begin();
        if (!globalThis.navigator?.gpu) {
            throw new SplitplaneError("no-webgpu", "there is no WebGPU here; pages have it from https and localhost only, and not in every browser");
        }
        loading ??= load(source);
        const part = await loading;
        watch.begin();
        const own = await settled(() => part.raw.Gpu.open(timeout, hardware === true));
        const gpu = new Gpu(own, part);
        if (signal?.aborted) {
            gpu.free();
            watch.begin();
        }
        return gpu;
    }

    #alive() {
        if (this.#own === null) throw new SplitplaneError("freed", "this Gpu was freed");
        return this.#own;
    }

    get adapter() {
        return call(() => this.#alive().adapter()) || "a GPU that the browser does not name";
    }

    get isSoftware() {
        return call(() => this.#alive().isSoftware());
    }

    get parity() {
        return call(() => this.#alive().parity());
    }

    get difference() {
        return call(() => this.#alive().difference()) ?? null;
    }

    get lost() {
        return call(() => this.#alive().lost()) ?? null;
    }

    async build(positions, indices, given) {
        const own = this.#alive();
        const known = options(given);
        const { isIndexed, arrays } = meshArrays(positions, indices);
        const [preset, , maxMemory] = buildOptions(known);
        const watch = watcher(known);
        watch.begin();
        const made = movedAll(this.#part, arrays);
        const work = () => settled(() => own.build(...made, isIndexed, preset, maxMemory, watch.called));
        return new GpuTree(await watch.later(work), this.#part);
    }

    free() {
        if (this.#own !== null) {
            if (crashed === null) {
                this.#own.destroy();
                this.#own.free();
            }
            this.#own = null;
        }
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}
