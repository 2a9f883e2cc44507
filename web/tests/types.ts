// Compiled, not run: what users write has the types of index.d.ts and three.d.ts.

import { BufferGeometry, Mesh, Raycaster } from "three";
import { AnyScene, AnyTree, Backend, Gpu, init, initThreads, Scene, SplitplaneError, Tree, WasmArray, whyNoThreads } from "splitplane";
import { acceleratedRaycast, computeBoundsTree, disposeBoundsTree } from "splitplane/three";

Mesh.prototype.raycast = acceleratedRaycast;
BufferGeometry.prototype.computeBoundsTree = computeBoundsTree;
BufferGeometry.prototype.disposeBoundsTree = disposeBoundsTree;

export async function use(positions: Float32Array, indices: Uint32Array, rays: Float32Array): Promise<number> {
    const threads: number = whyNoThreads() === null ? await initThreads({ threads: 4, maxMemory: 2 ** 30 }) : 1;
    if (threads === 1) await init();
    const controller = new AbortController();
    const tree = Tree.build(positions, indices, { preset: "best", signal: controller.signal, progress: (stage, done, total) => done < total });
    const hits = await tree.closestHitsAsync(rays, { accuracy: "exact", culling: "back" });
    const into = new WasmArray(rays.length / 2);
    const same: WasmArray = tree.closestHits(rays, { into });
    const single = tree.closestHit([0, 0, 0], [0, 0, 1], { tMax: 5 });
    const inside: Uint8Array = await tree.containsAsync(positions, { signal: controller.signal });
    const scene = new Scene();
    scene.addInstance(scene.addGeometry(positions, indices), new Float32Array(12), { mask: 1 });
    try {
        scene.update();
    } catch (error) {
        if (error instanceof SplitplaneError && error.code === "scene") throw error;
    }
    // @ts-expect-error no such preset
    Tree.build(positions, indices, { preset: "quick" });
    // @ts-expect-error not an array of floats
    tree.closestHits([1, 2, 3]);
    // @ts-expect-error made by Tree.build only
    new Tree();
    const backend = await Backend.open("auto", { timeout: 30, signal: controller.signal });
    const anyTree: AnyTree = await backend.build(positions, indices, { preset: "balanced" });
    const asked = await anyTree.closestHitsAsync(rays, { signal: controller.signal });
    const gpu = backend.gpu ?? (await Gpu.open());
    if (gpu.parity === "structural") console.log(gpu.adapter, gpu.difference?.length, asked.t.length);
    const kept: AnyTree = Tree.load((await gpu.build(positions, indices)).toBytes(positions, indices), positions, indices);
    const objects: AnyScene[] = [scene, gpu.scene(), backend.scene()];
    await objects[1].updateAsync({ maxMemory: 1e9 });
    const crossings = await (await gpu.build(positions)).allHitsAsync(rays, { culling: "back" });
    console.log(crossings.starts.length, (await objects[2].closestHitsAsync(rays, { mask: 3 })).instance.length);
    // @ts-expect-error no such backend
    await Backend.open("cuda");
    const raycaster = new Raycaster();
    raycaster.firstHitOnly = true;
    new BufferGeometry().computeBoundsTree({ layout: "compact" });
    kept.free();
    return hits.t.length + same.length + (single?.t ?? 0);
}
