// What scripts/threads.mjs times, in a worker with so many threads.

import * as api from "/js/index.js";
import { raySets, readObj } from "/scripts/rates.mjs";
import { Hash, Numbers, sphere } from "/tests/meshes.mjs";

let mesh = null;
let tree = null;
const sets = {};

async function begin({ threads, text, count }) {
    if (threads === 0) await api.init();
    else await api.initThreads({ threads });
    mesh = text === null ? sphere(150) : readObj(text);
    for (const [name, rays] of Object.entries(raySets(mesh.positions, count, new Numbers(3)))) {
        const asked = new api.WasmArray(rays.length);
        asked.floats.set(rays);
        sets[name] = { asked, into: new api.WasmArray(rays.length / 2) };
    }
    tree = api.Tree.build(mesh.positions, mesh.indices, { preset: "balanced" });
    return { digest: tree.digest, triangles: tree.summary.triangles };
}

/** Does one thing: its milliseconds, and a hash of what came of it. */
function once(what) {
    if (sets[what] === undefined) {
        const since = performance.now();
        const own = api.Tree.build(mesh.positions, mesh.indices, { preset: what });
        const took = performance.now() - since;
        const { digest } = own;
        own.free();
        return { took, answer: digest };
    }
    const { asked, into } = sets[what];
    const since = performance.now();
    tree.closestHits(asked, { into });
    return { took: performance.now() - since, answer: Hash.of(into.words) };
}

onmessage = async ({ data }) => {
    try {
        postMessage(typeof data === "string" ? once(data) : await begin(data));
    } catch (error) {
        postMessage({ error: String(error.stack ?? error) });
    }
};
