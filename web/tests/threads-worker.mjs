// What tests/browser.mjs runs in a worker of an isolated page: the package on several threads. The message says what is planted: nothing, a script
// of threads that cannot be loaded, or threads that trap.

import * as api from "/js/index.js";
import { noise } from "/tests/meshes.mjs";
import { failure, refusals, report } from "/tests/threads-answers.mjs";

/** Workers that run another script. */
function plant(script) {
    const Own = Worker;
    globalThis.Worker = class extends Own {
        constructor(_, settings) {
            super(script, settings);
        }
    };
}

const does = {
    async nothing() {
        const before = await refusals(api);
        await api.initThreads({ threads: 3 });
        return { before, ...(await report(api)) };
    },
    /** After the refusal one thread is left. */
    async noScript() {
        plant("/tests/not-there.mjs");
        const refused = await failure(api, () => api.initThreads({ threads: 2 }));
        await api.init();
        return { refused, about: api.about() };
    },
    async traps() {
        plant("/tests/threads-trap.mjs");
        await api.initThreads({ threads: 3 });
        const { positions, indices } = noise(100_000);
        let built = null;
        for (let round = 0; round < 1000 && built === null; round += 1) {
            built = await failure(api, () => api.Tree.build(positions, indices, { progress() {} }).free());
        }
        return { built, later: await failure(api, () => api.Tree.build(positions, indices)), isReady: api.isReady() };
    },
};

onmessage = async ({ data }) => {
    try {
        postMessage(await does[data]());
    } catch (error) {
        postMessage({ error: String(error.stack ?? error) });
    }
};
