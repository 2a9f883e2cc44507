// The compiled part: loading it, calling it, and arrays in its memory.

import load, * as single from "../pkg/splitplane.js";
import { SplitplaneError } from "./error.js";

/** The compiled part that is used: that of one thread, or that of several. */
export let raw = single;
let memory = null;
let loading = null;
let crashed = null;
/** Ends the other threads. */
let end = () => {};

/** Loads the compiled part; safe to call again. `source` as for `init` of index.d.ts. */
export function start(source) {
    loading ??= load(source === undefined ? undefined : { module_or_path: source }).then(
        (exports) => {
            memory = exports.memory;
        },
        (error) => {
            loading = null;
            throw new SplitplaneError("not-ready", `the compiled part cannot be loaded: ${error.message ?? error}`, { cause: error });
        },
    );
    return loading;
}

/** Takes another compiled part, in the place of what `start` loads: `work` gives a promise of it, of its memory, and of what ends its threads. */
export function startWith(work) {
    if (loading !== null) {
        const how = memory === null ? "is being loaded" : "is loaded";
        throw new SplitplaneError("config", `the compiled part ${how} already: call initThreads() once, in the place of init()`);
    }
    loading = work().then(
        (loaded) => {
            ({ raw, memory, end } = loaded);
        },
        (error) => {
            loading = null;
            throw error;
        },
    );
    return loading;
}

/** The compiled part is not to be called again. */
export function crash(message, cause) {
    crashed ??= new SplitplaneError("crashed", `${message}; load it anew`, { cause });
    end();
    return crashed;
}

function hasLostThread() {
    try {
        return raw.hasLostThread?.() === true;
    } catch {
        return false;
    }
}

export function isReady() {
    return memory !== null && crashed === null;
}

/** Calls the compiled part; its errors become ours. */
export function call(work) {
    if (memory === null) throw new SplitplaneError("not-ready", "the package is not loaded yet; await init() first");
    if (crashed !== null) throw new SplitplaneError("crashed", crashed.message, { cause: crashed.cause });
    try {
        return work();
    } catch (error) {
        if (error instanceof SplitplaneError) throw error;
        // Set by the compiled part.
        if (typeof error?.code === "string") throw new SplitplaneError(error.code, error.message);
        if (error instanceof WebAssembly.RuntimeError || error instanceof RangeError) {
            const what = hasLostThread() ? "a thread of the compiled part has ended" : `the compiled part has ended (${error.message})`;
            throw crash(`${what}, most likely for lack of memory`, error);
        }
        throw error;
    }
}

/** The reason of an array's refusal, by what it is. */
function kind(value) {
    if (value === null) return "null";
    return value?.constructor?.name ?? typeof value;
}

function refuse(what, wanted, value) {
    return new SplitplaneError("type", `${what} must be ${wanted}, but is ${kind(value)}`);
}

/**
 * Who calls an object of the compiled part right now. A progress callback runs in the middle of such a call, and may ask the object only what
 * changes nothing; while the call itself changes the object, nothing at all.
 */
export class Calls {
    #what;
    #changing = false;
    #asking = 0;

    constructor(what) {
        this.#what = what;
    }

    #refuse(isBusy) {
        if (!isBusy) return;
        const how = this.#changing ? "is being changed" : "is being asked";
        throw new SplitplaneError("busy", `this ${this.#what} ${how}; its progress callback cannot do that`);
    }

    /** Refuses a question while the object changes. */
    ask() {
        this.#refuse(this.#changing);
    }

    /** Refuses a change, or the end of the object, while it is called. */
    change() {
        this.#refuse(this.#changing || this.#asking > 0);
    }

    /** Asks by something that calls back. */
    asking(work) {
        this.ask();
        this.#asking += 1;
        try {
            return work();
        } finally {
            this.#asking -= 1;
        }
    }

    /** Changes by something that calls back. */
    changing(work) {
        this.change();
        this.#changing = true;
        try {
            return work();
        } finally {
            this.#changing = false;
        }
    }
}

/** An array of 32-bit words in the module's memory. */
export class WasmArray {
    #own;
    #calls = new Calls("WasmArray");

    /** Does work that holds arrays: they cannot be freed meanwhile. */
    static hold([array, ...rest], work) {
        if (array === undefined) return work();
        return array.#calls.asking(() => WasmArray.hold(rest, work));
    }

    constructor(length) {
        if (length instanceof raw.Words) {
            this.#own = length;
            return;
        }
        count(length, "the length");
        this.#own = call(() => new raw.Words(length));
    }

    /** What the compiled part takes. */
    get own() {
        if (this.#own === null) throw new SplitplaneError("freed", "this WasmArray was freed");
        return this.#own;
    }

    get length() {
        return this.own.length();
    }

    get floats() {
        return new Float32Array(memory.buffer, this.own.pointer(), this.own.length());
    }

    get words() {
        return new Uint32Array(memory.buffer, this.own.pointer(), this.own.length());
    }

    get bytes() {
        return new Uint8Array(memory.buffer, this.own.pointer(), 4 * this.own.length());
    }

    free() {
        if (this.#own !== null) {
            this.#calls.change();
            this.#own.free();
            this.#own = null;
        }
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}

/** Whole numbers from 0 to 2^32 - 2. */
export function count(value, what, most = 0xfffffffe) {
    if (typeof value !== "number") throw refuse(what, "a number", value);
    if (!Number.isInteger(value) || value < 0 || value > most) {
        throw new SplitplaneError("config", `${what} is ${value}, but must be a whole number from 0 to ${most}`);
    }
    return value;
}

export function number(value, what) {
    if (typeof value !== "number") throw refuse(what, "a number", value);
    return value;
}

/** One of some names, as its number. */
export function choice(value, what, names) {
    const place = names.indexOf(value);
    if (place < 0) throw new SplitplaneError("config", `there is no ${what} \`${String(value)}\`; there are ${names.join(", ")}`);
    return place;
}

/** Refuses a typed array that has lost what it showed: such a one has no length, and would pass for an empty one. */
export function refuseEnded(array, what) {
    try {
        new Uint8Array(array.buffer);
    } catch {
        throw new SplitplaneError("type", `${what} is a view that has ended: its memory was given away, or has grown`);
    }
}

/** An object of options, or none. */
export function options(value) {
    if (value === undefined) return {};
    if (typeof value !== "object" || value === null) throw refuse("options", "an object", value);
    return value;
}

/**
 * Runs `work` with arrays of the module's memory that hold what is given: typed arrays are copied there and freed afterwards, arrays
 * that are there already are taken as they are.
 */
export function withArrays(given, work) {
    const made = [];
    try {
        const arrays = given.map(({ value, what, type, each, optional }) => {
            if (optional && (value === undefined || value === null)) value = new type(0);
            const isOurs = value instanceof WasmArray && type !== Uint8Array;
            if (!(value instanceof type) && !isOurs) {
                throw refuse(what, type === Uint8Array ? "a Uint8Array" : `a ${type.name} or a WasmArray`, value);
            }
            if (!isOurs) refuseEnded(value, what);
            if (value.length % each !== 0) {
                throw new SplitplaneError("shape", `${what}: the length is ${value.length}, but must be a multiple of ${each}`);
            }
            if (isOurs) return value;
            const { buffer, byteOffset, length } = value;
            const isWithin = buffer === memory?.buffer;
            const array = new WasmArray(type === Uint8Array ? Math.ceil(length / 4) : length);
            made.push(array);
            const view = type === Float32Array ? array.floats : type === Uint32Array ? array.words : array.bytes;
            // The module's memory may have grown just now, which ends the views of it.
            view.set(isWithin ? new type(memory.buffer, byteOffset, length) : value);
            return array;
        });
        return WasmArray.hold(arrays, () => work(...arrays));
    } finally {
        // After a crash there is nothing to be freed.
        if (crashed === null) for (const array of made) array.free();
    }
}

/**
 * Progress and the end of work from outside. The compiled part calls `called` as (stage, done, total) and ends the work where it gives
 * true; `after` throws what ended it.
 */
export function watcher({ progress, signal }) {
    if (progress !== undefined && typeof progress !== "function") throw refuse("progress", "a function", progress);
    if (signal !== undefined && typeof signal?.aborted !== "boolean") throw refuse("signal", "an AbortSignal", signal);
    let thrown = null;
    const called = (stage, done, total) => {
        if (signal?.aborted) return true;
        try {
            return progress?.(stage, done, total) === false;
        } catch (error) {
            thrown ??= { error };
            return true;
        }
    };
    const aborted = (message) => new SplitplaneError("cancelled", message, { cause: signal.reason });
    return {
        called: progress === undefined && signal === undefined ? undefined : called,
        /** Runs the work, and says who ended it. */
        run(work) {
            if (signal?.aborted) throw aborted("cancelled before it began");
            try {
                return call(work);
            } catch (error) {
                if (thrown !== null) throw thrown.error;
                if (error.code === "cancelled" && signal?.aborted) throw aborted(error.message);
                throw error;
            }
        },
        /** Refuses to begin what was cancelled before. */
        begin() {
            if (signal?.aborted) throw aborted("cancelled before it began");
        },
        /** Does work that gives a promise, and says who ended it. */
        async later(work) {
            try {
                return await work();
            } catch (error) {
                if (thrown !== null) throw thrown.error;
                if (error.code === "cancelled" && signal?.aborted) throw aborted(error.message);
                throw error;
            }
        },
        /** Between two slices of a batch, in the place of the compiled part. */
        between(done, total, what) {
            const ends = called(what, done, total);
            if (thrown !== null) throw thrown.error;
            if (!ends) return;
            const message = `cancelled after ${done} of ${total} ${what}`;
            throw signal?.aborted ? aborted(message) : new SplitplaneError("cancelled", message);
        },
        isWatched: progress !== undefined || signal !== undefined,
    };
}

/** Lets the event loop run. */
export function pause() {
    if (typeof scheduler !== "undefined" && scheduler.yield) return scheduler.yield();
    return new Promise((resume) => {
        // A timer would wait 4 ms after some of them.
        const { port1, port2 } = new MessageChannel();
        port1.onmessage = () => {
            port1.close();
            resume();
        };
        port2.postMessage(0);
    });
}
