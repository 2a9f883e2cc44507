// What the tests of threads in Node and in a browser's worker have in common: a report on the package on several threads.

import { all } from "./answers.mjs";
import { noise, rays } from "./meshes.mjs";

/** The code of the error that work ends in, its text and its cause; `null` where it ends well. */
export async function failure(api, work) {
    try {
        await work();
        return null;
    } catch (error) {
        if (!(error instanceof api.SplitplaneError)) return { code: `not ours: ${error.stack ?? error}` };
        return { code: error.code, text: error.message, cause: typeof error.cause === "string" ? error.cause : undefined };
    }
}

/** Refusals before there are threads. */
export async function refusals(api) {
    const of = (given) => failure(api, () => api.initThreads(given));
    return {
        why: api.whyNoThreads(),
        isReady: api.isReady(),
        zero: await of({ threads: 0 }),
        tooMany: await of({ threads: 65 }),
        part: await of({ threads: 1.5 }),
        text: await of({ threads: "2" }),
        little: await of({ threads: 2, maxMemory: 1000 }),
        none: await of(3),
        noModule: await of({ threads: 2, source: Uint8Array.of(1, 2, 3) }),
    };
}

/** Everything on threads that are there. */
export async function report(api) {
    const { threads } = api.about();
    const again = await failure(api, () => api.initThreads({ threads: 2 }));
    await api.init();
    const lines = all(api);
    const { positions, indices } = noise(60_000);
    // Progress is told by this thread, whoever made it; stages come in order, and what is done never decreases in one.
    const calls = [];
    const tree = api.Tree.build(positions, indices, { preset: "best", progress: (stage, done) => void calls.push([stage, done]) });
    const isOrdered = calls.every(([stage, done], i) => i === 0 || calls[i - 1][0] !== stage || calls[i - 1][1] <= done);
    let count = 0;
    const ended = await failure(api, () => api.Tree.build(positions, indices, { progress: () => ++count < 5 }));
    const little = await failure(api, () => api.Tree.build(positions, indices, { maxMemory: 100_000 }));
    // A callback that itself builds and asks.
    const inner = new Set();
    const small = noise(3000);
    api.Tree.build(positions, indices, {
        progress() {
            if (inner.size > 0 && count++ % 8 !== 0) return;
            const own = api.Tree.build(small.positions, small.indices);
            inner.add(own.digest);
            own.free();
        },
    }).free();
    const asked = rays(200_000, 4);
    const controller = new AbortController();
    const aborted = await failure(api, () =>
        tree.closestHitsAsync(asked, { signal: controller.signal, progress: (_, done) => void (done > 0 && controller.abort("enough")) }));
    const hits = await tree.closestHitsAsync(asked);
    const found = hits.triangle.reduce((sum, triangle) => sum + Number(triangle !== api.NONE), 0);
    const { digest } = tree;
    tree.free();
    return { threads, about: api.about(), again, lines, calls: calls.length, isOrdered, ended, count, little, inner: inner.size, aborted, found, digest };
}
