// How many bytes a visitor loads, compressed as servers do it; refuses more than is promised.

import { readFileSync } from "node:fs";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";

const limits = [
    ["queries alone", ["../pkg/splitplane_bg.wasm"], 400_000],
    ["WebGPU, when it is asked for", ["../pkg/gpu/splitplane_gpu_bg.wasm"], 400_000],
    ["the demonstration page, with WebGPU", ["../target/page/pkg/splitplane_bg.wasm"], 1_500_000],
];
let refused = false;
for (const [what, paths, limit] of limits) {
    const bytes = Buffer.concat(paths.map((path) => readFileSync(new URL(path, import.meta.url))));
    const brotli = brotliCompressSync(bytes, { params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_LGWIN]: 24 } }).length;
    const gzip = gzipSync(bytes, { level: 9 }).length;
    const told = `${bytes.length} bytes, ${gzip} by gzip, ${brotli} by Brotli`;
    console.log(`${what}: ${told}; at most ${limit} by Brotli are allowed`);
    refused ||= brotli > limit;
}
process.exit(refused ? 1 : 0);
