// What trees and scenes take of meshes, and options of builds.

import { SplitplaneError } from "./error.js";
import { number } from "./module.js";

/** What `maxMemory` may be. */
export function limit(value) {
    if (value === undefined || value === null) return undefined;
    number(value, "maxMemory");
    if (!(value >= 0)) throw new SplitplaneError("config", `maxMemory is ${value}, but must be 0 or more`);
    return value;
}

export function buildOptions({ preset = "fast", layout = "fast", maxMemory }) {
    return [String(preset), String(layout), limit(maxMemory)];
}

/** What `withArrays` takes of a mesh. */
export function meshArrays(positions, indices) {
    const isIndexed = indices !== undefined && indices !== null;
    return {
        isIndexed,
        arrays: [
            { value: positions, what: "positions", type: Float32Array, each: isIndexed ? 3 : 9 },
            { value: indices, what: "indices", type: Uint32Array, each: 3, optional: true },
        ],
    };
}
