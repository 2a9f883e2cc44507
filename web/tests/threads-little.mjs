// Threads where memory of more than 1 GiB is refused, as by a phone: what was asked for by number, and what was left to the package. With `none`
// where all such memory is refused.

import * as api from "../js/node.js";
import { noise } from "./meshes.mjs";
import { failure } from "./threads-answers.mjs";

const most = process.argv[2] === "none" ? 0 : 2 ** 14;
const granted = [];
WebAssembly.Memory = new Proxy(WebAssembly.Memory, {
    construct(Own, [given]) {
        if (given.maximum > most) throw new RangeError("no room");
        granted.push(given.maximum);
        return new Own(given);
    },
});
const { positions, indices } = noise(1000);
const digest = () => api.Tree.build(positions, indices).digest;
if (most === 0) {
    const refused = await failure(api, () => api.initThreads({ threads: 2 }));
    await api.init();
    console.log(JSON.stringify({ refused, threads: api.about().threads, digest: digest() }));
} else {
    const refused = await failure(api, () => api.initThreads({ threads: 2, maxMemory: 2 ** 31 }));
    const threads = await api.initThreads({ threads: 2 });
    console.log(JSON.stringify({ refused, threads, granted, digest: digest() }));
}
