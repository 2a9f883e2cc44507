// What scenes of many objects have in common, on the CPU and on a browser's GPU: their instances.

import { CULLINGS } from "./batch.js";
import { SplitplaneError } from "./error.js";
import { choice, count, options } from "./module.js";

/** All bits of a mask. */
export const ALL = 0xffffffff;

/** Three rows of four, from 12 numbers by rows or the 16 of a column-major matrix, as WebGL and three.js have them. */
function rows(matrix) {
    const length = matrix?.length;
    if (length !== 12 && length !== 16) {
        throw new SplitplaneError("shape", `a matrix has ${length} numbers, but must have 12 (by rows) or 16 (by columns)`);
    }
    const all = Array.from(matrix);
    if (!all.every((part) => typeof part === "number")) throw new SplitplaneError("type", "a matrix must be of numbers");
    if (length === 12) return Float32Array.from(all);
    if (all[3] !== 0 || all[7] !== 0 || all[11] !== 0 || all[15] !== 1) {
        throw new SplitplaneError("shape", "a matrix of 16 numbers must be affine: its last row 0, 0, 0, 1");
    }
    return Float32Array.from({ length: 12 }, (_, place) => all[4 * (place % 4) + Math.floor(place / 4)]);
}

/** The part of a scene that is the same on both. */
export class Instances {
    #alive;
    #call;

    /** `alive` gives the compiled part's scene, or throws; `call` calls that part. */
    constructor(alive, call) {
        this.#alive = alive;
        this.#call = call;
    }

    removeGeometry(geometry) {
        const own = this.#alive();
        count(geometry, "geometry");
        this.#call(() => own.removeGeometry(geometry));
    }

    addInstance(geometry, matrix, given) {
        const own = this.#alive();
        const { mask = ALL, culling = "none" } = options(given);
        count(geometry, "geometry");
        count(mask, "mask", ALL);
        const [transform, side] = [rows(matrix), choice(culling, "culling", CULLINGS)];
        return this.#call(() => own.addInstance(geometry, transform, mask, side));
    }

    moveInstance(instance, matrix) {
        const own = this.#alive();
        count(instance, "instance");
        const transform = rows(matrix);
        this.#call(() => own.moveInstance(instance, transform));
    }

    removeInstance(instance) {
        const own = this.#alive();
        count(instance, "instance");
        this.#call(() => own.removeInstance(instance));
    }

    get digest() {
        return this.#call(() => this.#alive().digest());
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}
