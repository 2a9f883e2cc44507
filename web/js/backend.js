// CPU or GPU behind one choice.

import { SplitplaneError } from "./error.js";
import { Gpu } from "./gpu.js";
import { choice, options } from "./module.js";
import { Scene } from "./scene.js";
import { Tree } from "./tree.js";

export const BACKENDS = ["auto", "cpu", "gpu"];

/** Why `auto` does without a GPU; errors of other kinds are the caller's. */
const WITHOUT = ["no-webgpu", "device", "device-lost", "timed-out", "out-of-memory", "not-ready", "crashed"];

/** What builds trees; see index.d.ts. */
export class Backend {
    #gpu;
    #reason;
    #isAuto;

    constructor(gpu, reason, isAuto) {
        if (typeof reason !== "string") throw new SplitplaneError("type", "a Backend is made by Backend.open");
        this.#gpu = gpu;
        this.#reason = reason;
        this.#isAuto = isAuto;
    }

    static async open(name = "auto", given) {
        choice(name, "backend", BACKENDS);
        const known = options(given);
        if (name === "cpu") return new Backend(null, "cpu: as asked", false);
        if (name === "gpu") return new Backend(await Gpu.open(known), "gpu: as asked", false);
        let gpu;
        try {
            gpu = await Gpu.open({ ...known, hardware: true });
        } catch (error) {
            if (!WITHOUT.includes(error?.code)) throw error;
            return new Backend(null, `auto: the CPU, since ${error.message}`, true);
        }
        if (gpu.parity === "bitwise") return new Backend(gpu, `auto: \`${gpu.adapter}\` is hardware; parity: bitwise`, true);
        const reason = `auto: the CPU, since \`${gpu.adapter}\` differs from it: ${gpu.difference}`;
        gpu.free();
        return new Backend(null, reason, true);
    }

    get name() {
        return this.#gpu === null ? "cpu" : "gpu";
    }

    get gpu() {
        return this.#gpu;
    }

    get reason() {
        return this.#reason;
    }

    scene() {
        return this.#gpu === null ? new Scene() : this.#gpu.scene();
    }

    async build(positions, indices, given) {
        // What a GPU does not build, the choice was not for.
        const known = options(given);
        const onCpu = this.#gpu === null || (this.#isAuto && known.preset === "best");
        return onCpu ? Tree.buildAsync(positions, indices, known) : this.#gpu.build(positions, indices, known);
    }

    free() {
        this.#gpu?.free();
        this.#gpu = null;
    }

    [Symbol.dispose ?? Symbol.for("Symbol.dispose")]() {
        this.free();
    }
}
