// Batches of rays and points: in slices, between which others can be told of progress, end the work, or have the event loop.

import { SplitplaneError } from "./error.js";
import { WasmArray, choice, count, options, pause, watcher, withArrays } from "./module.js";

export const ACCURACIES = ["fast", "watertight", "exact"];
export const CULLINGS = ["none", "back", "front"];
/** Stands for no triangle. */
export const NONE = 0xffffffff;

/** Rays of one slice of a batch that nobody waits for. */
const SLICE = 1 << 16;
/** Rays of the first slice of one that must not hold up the event loop, and how long one may take, in milliseconds. */
const FIRST = 256;
const TOO_LONG = 8;

export function queryOptions(given) {
    const { accuracy = "watertight", culling = "none", ignore, into } = given;
    return {
        accuracy: choice(accuracy, "accuracy", ACCURACIES),
        culling: choice(culling, "culling", CULLINGS),
        ignore: ignore === undefined || ignore === null ? NONE : count(ignore, "ignore"),
        into,
    };
}

/** Room for the answers: what is given for them, or an array of our own. */
export function room(into, rays, words, what) {
    if (into === undefined) return new WasmArray(words);
    if (!(into instanceof WasmArray)) throw new SplitplaneError("type", `into must be a WasmArray for ${what}`);
    if (into === rays) throw new SplitplaneError("type", "into is the array that is asked about; answers need one of their own");
    if (into.length < words) {
        throw new SplitplaneError("shape", `into has ${into.length} words, but ${what} take ${words}`);
    }
    return into;
}

/** Does the slices of a batch one after the other. */
export function inSlices(total, what, given, work) {
    const watch = watcher(given);
    if (watch.isWatched) watch.between(0, total, what);
    for (let first = 0; first < total; first += SLICE) {
        const some = Math.min(SLICE, total - first);
        watch.run(() => work(first, some));
        if (watch.isWatched) watch.between(first + some, total, what);
    }
}

/** The same with the event loop in between: slices take about 8 ms. */
export async function inSlicesAsync(total, what, given, work) {
    const watch = watcher(given);
    watch.between(0, total, what);
    let size = FIRST;
    for (let first = 0; first < total; ) {
        const some = Math.min(size, total - first);
        const since = performance.now();
        watch.run(() => work(first, some));
        const took = performance.now() - since;
        if (took > TOO_LONG) size = Math.max(1, size >> 1);
        else if (took < TOO_LONG / 2) size = Math.min(SLICE, size << 1);
        first += some;
        await pause();
        watch.between(first, total, what);
    }
}

/** What is given, in an array of the module's memory. */
function copy(rays, what, type, each) {
    return withArrays([{ value: rays, what, type, each }], (given) => {
        const copied = new WasmArray(given.length);
        copied.words.set(given.words);
        return copied;
    });
}

/**
 * The two forms of a query of a batch, at once and asynchronous. Rays or points have `each` words; `prepare(options)` checks options,
 * `ask(own, rays, answers, first, count, options)` answers a slice, and `give(answers, total)` makes of the answers what the caller gets.
 */
export function batch({ what, type, each, answerWords, prepare, ask, give }) {
    const begin = (given) => {
        const known = options(given);
        return { ...prepare(known), progress: known.progress, signal: known.signal };
    };
    const now = (self, rays, given) => {
        const known = begin(given);
        return withArrays([{ value: rays, what, type, each }], (asked) => {
            const total = asked.length / each;
            const answers = room(known.into, rays, answerWords(total), "the answers");
            try {
                inSlices(total, what, known, (first, some) => ask(self(), asked.own, answers.own, first, some, known));
                return known.into === undefined ? give(answers, total) : answers;
            } finally {
                if (known.into === undefined) answers.free();
            }
        });
    };
    /** `version` is another number after a change: answers of two states are not mixed. */
    const later = async (self, rays, given, version) => {
        const known = begin(given);
        // The caller's array may change meanwhile, so it is copied; arrays of the module's are the caller's to keep.
        const copied = rays instanceof WasmArray ? null : copy(rays, what, type, each);
        const asked = copied ?? rays;
        let answers = null;
        try {
            const total = withArrays([{ value: asked, what, type, each }], () => asked.length / each);
            answers = room(known.into, rays, answerWords(total), "the answers");
            const before = version();
            await inSlicesAsync(total, what, known, (first, some) => {
                const own = self();
                if (version() !== before) throw new SplitplaneError("busy", `what these ${what} were asked of has changed meanwhile; ask it again`);
                ask(own, asked.own, answers.own, first, some, known);
            });
            return known.into === undefined ? give(answers, total) : answers;
        } finally {
            copied?.free();
            if (known.into === undefined) answers?.free();
        }
    };
    return { now, later };
}
