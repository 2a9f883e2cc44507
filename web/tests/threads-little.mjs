// Threads where memory of more than 1 GiB is refused, as by a phone: what was asked for by number, and what was left to the package.

import * as api from "../js/node.js";
import { noise } from "./meshes.mjs";
import { failure } from "./threads-answers.mjs";

WebAssembly.Memory = new Proxy(WebAssembly.Memory, {
    construct(Own, [given]) {
        if (given.maximum > 2 ** 14) throw new RangeError("no room");
        return new Own(given);
    },
});
const refused = await failure(api, () => api.initThreads({ threads: 2, maxMemory: 2 ** 31 }));
const threads = await api.initThreads({ threads: 2 });
const { positions, indices } = noise(1000);
const tree = api.Tree.build(positions, indices);
console.log(JSON.stringify({ refused, threads, digest: tree.digest }));
