// Threads: workers that share the memory of a compiled part. The package and the demonstration page have one such part each.

import { SplitplaneError } from "./error.js";

/** Most threads: more do not pay. */
export const MOST_THREADS = 64;
/** How long workers may take to begin, in milliseconds. */
const PATIENCE = 30_000;
/** How long a thread that trapped waits before it tells the others once more, in milliseconds. */
const AGAIN = 50;
/** Bytes of a page of memory; pages that the compiled part has from the start, and the most that there can be. */
const PAGE = 65_536;
const [FIRST_PAGES, MOST_PAGES] = [256, 65_536];
export const [LEAST_MEMORY, MOST_MEMORY] = [32 * 1024 * 1024, MOST_PAGES * PAGE];

const HEADERS = "Cross-Origin-Opener-Policy: same-origin and Cross-Origin-Embedder-Policy: require-corp";

/** Why there can be no threads here; `null` where there can. */
export function whyNot() {
    if (globalThis.crossOriginIsolated === false) return `the page is not isolated: it has to be served with ${HEADERS}`;
    if (typeof SharedArrayBuffer === "undefined") return "there is no memory here that workers can share";
    try {
        Atomics.wait(new Int32Array(new SharedArrayBuffer(4)), 0, 0, 0);
    } catch {
        return "a window's own thread cannot wait for others; call it in a Worker";
    }
    return null;
}

/** How many threads pay here. */
export function threadsHere() {
    return Math.min(MOST_THREADS, globalThis.navigator?.hardwareConcurrency || 2);
}

function refused(why, cause) {
    return new SplitplaneError("threads", `there are no threads: ${why}`, { cause });
}

/** A worker of a browser, as `startPool` takes it. */
export function webWorker(worker) {
    return {
        post: (told) => worker.postMessage(told),
        hear(message, failed) {
            worker.onmessage = ({ data }) => message(data);
            worker.onmessageerror = () => failed("a worker cannot be told of the shared memory");
            worker.onerror = (event) => {
                event.preventDefault?.();
                failed(event.message || "a worker cannot be loaded");
            };
        },
        end: () => worker.terminate(),
    };
}

/** Starts a worker: a promise that it is there. What ends it later goes to `ended`. */
function begin(worker, told, ended) {
    return new Promise((resolve, reject) => {
        const late = setTimeout(() => reject(refused(`a worker has not begun after ${PATIENCE / 1000} s`)), PATIENCE);
        // Where others are refused first, Node is not to wait for this.
        late.unref?.();
        const fail = (text) => {
            clearTimeout(late);
            reject(refused(text));
            ended(text);
        };
        worker.hear(({ begun, failed }) => {
            if (!begun) return fail(failed);
            clearTimeout(late);
            resolve();
        }, fail);
        worker.post(told);
    });
}

/**
 * Memory of at most `maxMemory` bytes; without that, of the most for which there is room here, and of no fewer than `least`: a phone has no 4 GiB of
 * addresses to spare.
 */
function sharedMemory(maxMemory, least) {
    for (let most = maxMemory ?? MOST_MEMORY; ; most /= 2) {
        try {
            return { memory: new WebAssembly.Memory({ initial: FIRST_PAGES, maximum: Math.floor(most / PAGE), shared: true }), most };
        } catch (error) {
            if (maxMemory === undefined && most / 2 >= least) continue;
            const advice = maxMemory === undefined ? "" : "; try a smaller maxMemory";
            throw refused(`there is no shared memory of ${most} bytes (${error.message})${advice}`, error);
        }
    }
}

/** The compiled module, of what `init` of index.d.ts takes. */
async function compiled(source) {
    if (source instanceof WebAssembly.Module) return source;
    const isAddress = typeof source === "string" || source instanceof URL || (typeof Request === "function" && source instanceof Request);
    const given = await (isAddress ? fetch(source) : source);
    if (typeof Response !== "function" || !(given instanceof Response)) return WebAssembly.compile(given);
    if (!given.ok) throw new Error(`${given.url}: status ${given.status}`);
    const isWasm = given.headers.get("Content-Type") === "application/wasm";
    return isWasm ? WebAssembly.compileStreaming(given) : WebAssembly.compile(await given.arrayBuffer());
}

/** The memory, the most bytes of it, and the module of parts that are loaded: what goes wrong after that may be tried again, but a part is loaded once. */
const loaded = new WeakMap();

async function loadShared(raw, { source, maxMemory, least = LEAST_MEMORY }) {
    const before = loaded.get(raw);
    if (before !== undefined) {
        if (maxMemory === undefined || maxMemory === before.most) return before;
        throw new SplitplaneError("config", `maxMemory is ${maxMemory}, but the compiled part was loaded before, with ${before.most} bytes at most`);
    }
    const { memory, most } = sharedMemory(maxMemory, least);
    try {
        const module = await compiled(source);
        await raw.default({ module_or_path: module, memory });
        loaded.set(raw, { module, memory, most });
        return { module, memory, most };
    } catch (error) {
        throw new SplitplaneError("not-ready", `the compiled part for threads cannot be loaded: ${error.message ?? error}`, { cause: error });
    }
}

/**
 * Loads a compiled part for `threads` threads, of which this is one: its memory, the most bytes of that, and what ends all others. `spawn` starts a worker, which calls
 * `runThread`; `ended` is called with a text when one has ended.
 */
export async function startPool(raw, { threads, spawn, ended, ...asked }) {
    const workers = [];
    const end = () => {
        for (const worker of workers.splice(0)) worker.end();
    };
    let isOn = false;
    const hears = (text) => {
        if (isOn) ended(text);
    };
    try {
        const { most, ...told } = await loadShared(raw, asked);
        for (let i = 1; i < threads; i += 1) workers.push(spawn());
        await Promise.all(workers.map((worker) => begin(worker, told, hears)));
        raw.beginThreads(threads);
        isOn = true;
        return { memory: told.memory, most, end };
    } catch (error) {
        end();
        throw error instanceof SplitplaneError ? error : refused(error.message ?? error, error);
    }
}

/** What a worker does: a thread of the pool. `post` answers who started it. */
export async function runThread(raw, { module, memory }, post) {
    try {
        await raw.default({ module_or_path: module, memory });
    } catch (error) {
        post({ failed: `a worker cannot load the compiled part: ${error.message ?? error}` });
        return;
    }
    post({ begun: true });
    try {
        raw.runThread();
    } catch (error) {
        // Others wait for what this one has begun: they are to trap, too. Who started this one then ends it.
        const tell = () => {
            try {
                raw.endThreads();
            } catch {
                // There is no memory for that yet.
            }
        };
        tell();
        setInterval(tell, AGAIN);
        post({ failed: error.message ?? String(error) });
    }
}
