// Builds larger and larger trees in little memory, on two threads, and prints how that ended.

import * as api from "../js/node.js";
import { noise } from "./meshes.mjs";
import { failure } from "./threads-answers.mjs";

await api.initThreads({ threads: 2, maxMemory: 32 * 1024 * 1024 });
const codes = [];
for (const triangles of [1000, 20_000, 60_000, 100_000, 200_000]) {
    const { positions, indices } = noise(triangles);
    const found = await failure(api, () => api.Tree.build(positions, indices, { preset: "balanced" }).free());
    codes.push(found?.code ?? null);
}
console.log(JSON.stringify({ codes }));
