// The queries of a tree, and the form of their answers.

import { ACCURACIES, NONE, batch, queryOptions } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { limit } from "./mesh.js";
import { WasmArray, choice, count, number } from "./module.js";

/** One column of records of `wide` words. */
export function column(words, total, wide, place, type) {
    const out = new type(total);
    for (let i = 0, at = place; i < total; i += 1, at += wide) out[i] = words[at];
    return out;
}

export const closest = batch({
    what: "rays",
    type: Float32Array,
    each: 8,
    answerWords: (total) => 4 * total,
    prepare: queryOptions,
    ask: (own, rays, hits, first, some, { accuracy, culling, ignore }) =>
        own.closestHits(rays, hits, first, some, accuracy, culling, ignore),
    give: (hits, total) => ({
        t: column(hits.floats, total, 4, 0, Float32Array),
        triangle: column(hits.words, total, 4, 1, Uint32Array),
        u: column(hits.floats, total, 4, 2, Float32Array),
        v: column(hits.floats, total, 4, 3, Float32Array),
    }),
});

export const any = batch({
    what: "rays",
    type: Float32Array,
    each: 8,
    answerWords: (total) => Math.ceil(total / 4),
    prepare: queryOptions,
    ask: (own, rays, occluded, first, some, { accuracy, culling, ignore }) =>
        own.anyHits(rays, occluded, first, some, accuracy, culling, ignore),
    give: (occluded, total) => occluded.bytes.slice(0, total),
});

export const windings = batch({
    what: "points",
    type: Float32Array,
    each: 3,
    answerWords: (total) => 2 * total,
    prepare: ({ maxMemory, into }) => ({ maxMemory: limit(maxMemory), into }),
    ask: (own, points, found, first, some, { maxMemory }) => own.locate(points, found, first, some, maxMemory, undefined),
    give: (found, total) => ({
        // Numbers of 32 bits become those of the array's type.
        winding: column(found.words, total, 2, 0, Int32Array),
        boundary: column(found.words, total, 2, 1, Uint8Array),
    }),
});

export const near = batch({
    what: "points",
    type: Float32Array,
    each: 3,
    answerWords: (total) => 8 * total,
    prepare: ({ maxDistance = Infinity, accuracy = "watertight", ignore, into }) => {
        number(maxDistance, "maxDistance");
        if (ACCURACIES[choice(accuracy, "accuracy", ACCURACIES)] === "exact") {
            throw new SplitplaneError("config", "closest points of accuracy `exact` are not offered in WebAssembly; leave accuracy out");
        }
        if (!(maxDistance >= 0)) throw new SplitplaneError("config", `maxDistance is ${maxDistance}, but must be 0 or more`);
        return { maxDistance, ignore: ignore === undefined || ignore === null ? NONE : count(ignore, "ignore"), into };
    },
    ask: (own, points, found, first, some, { maxDistance, ignore }) =>
        own.closestPoints(points, found, first, some, maxDistance, ignore, undefined),
    give: (found, total) => {
        const { floats, words } = found;
        const point = new Float32Array(3 * total);
        const distance = new Float64Array(total);
        const squares = new DataView(words.buffer, words.byteOffset, 32 * total);
        for (let i = 0; i < total; i += 1) {
            distance[i] = Math.sqrt(squares.getFloat64(32 * i, true));
            for (let axis = 0; axis < 3; axis += 1) point[3 * i + axis] = floats[8 * i + 2 + axis];
        }
        return {
            distance,
            point,
            triangle: column(words, total, 8, 5, Uint32Array),
            u: column(floats, total, 8, 6, Float32Array),
            v: column(floats, total, 8, 7, Float32Array),
        };
    },
});

// Room for a single ray and its hit, made when first needed.
let one = null;

/** A single ray in the module's memory. */
export function oneRay(origin, direction, { tMin = 0, tMax = Infinity }) {
    for (const [vector, what] of [[origin, "origin"], [direction, "direction"]]) {
        const isVector = vector?.length === 3 && [0, 1, 2].every((axis) => typeof vector[axis] === "number");
        if (!isVector) throw new SplitplaneError("type", `${what} must be three numbers`);
    }
    number(tMin, "tMin");
    number(tMax, "tMax");
    one ??= { ray: new WasmArray(8), hit: new WasmArray(4) };
    one.ray.floats.set([origin[0], origin[1], origin[2], tMin, direction[0], direction[1], direction[2], tMax]);
    return one;
}

/** All crossings of a batch: where those of each ray begin, and 5 words each. */
export function allFound(starts, words) {
    const total = words.length / 5;
    const floats = new Float32Array(words.buffer, words.byteOffset, words.length);
    return {
        starts: starts.slice(),
        t: column(floats, total, 5, 0, Float32Array),
        triangle: column(words, total, 5, 1, Uint32Array),
        u: column(floats, total, 5, 2, Float32Array),
        v: column(floats, total, 5, 3, Float32Array),
        front: column(words, total, 5, 4, Uint8Array),
    };
}

/** The hits of a scene, 6 words each. */
export function sceneHits(words, total) {
    const floats = new Float32Array(words.buffer, words.byteOffset, words.length);
    return {
        t: column(floats, total, 6, 0, Float32Array),
        u: column(floats, total, 6, 1, Float32Array),
        v: column(floats, total, 6, 2, Float32Array),
        triangle: column(words, total, 6, 3, Uint32Array),
        geometry: column(words, total, 6, 4, Uint32Array),
        instance: column(words, total, 6, 5, Uint32Array),
    };
}
