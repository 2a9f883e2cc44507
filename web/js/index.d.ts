/**
 * Ray queries on triangle meshes and scenes of instances of them, by SAH kd-trees in WebAssembly. Equal input gives an equal tree and equal
 * answers, bit for bit, here and in the Rust library.
 *
 * Rays are 8 floats: origin (3), `tMin`, direction (3), `tMax`. The direction may have any length but 0; `t` is in units of it. Both limits
 * are included. A ray with a number that is not finite (limits may be infinite) or without direction hits nothing.
 */

/** What kind of error it is; `CODES` lists them with their meanings. */
export type Code =
    | "not-ready" | "type" | "shape" | "config" | "mesh" | "freed" | "busy" | "cancelled" | "out-of-memory" | "wrong-mesh"
    | "file" | "unknown" | "stale" | "scene" | "threads" | "no-webgpu" | "device-lost" | "timed-out" | "device" | "build" | "query" | "crashed";

/** Every error that the package throws by itself. `message` is the library's text; after an abort `cause` is the signal's reason. */
export class SplitplaneError extends Error {
    readonly code: Code;
}
export const CODES: readonly Code[];

/**
 * Loads the compiled part; await it before all else. Safe to call again. `source` is where it is, if not beside the package: a URL, a
 * response, its bytes, or the compiled module.
 */
export function init(source?: string | URL | Request | Response | Promise<Response> | BufferSource | WebAssembly.Module): Promise<void>;
/** What `initThreads` takes. */
export interface ThreadsOptions {
    /** How many, the calling one included: 1 to 64. As many as the machine has cores if left out. */
    threads?: number;
    /** Where the compiled part for threads is, if not beside the package; as for `init`. */
    source?: Parameters<typeof init>[0];
    /**
     * Most bytes of the shared memory, 32 MiB to 4 GiB: browsers set that much address space aside, and on phones may refuse it. If left out, 4 GiB, or
     * half of what was refused, again and again.
     */
    maxMemory?: number;
}

/**
 * In the place of `init`: loads the compiled part for several threads, among which builds, batches and updates are divided. Gives the number of
 * threads. All other functions stay the same, and so do their answers, bit for bit.
 *
 * In a browser the page has to be isolated (`crossOriginIsolated`), and a Worker has to call it, since a window's own thread cannot wait. Node has no
 * such conditions. Where there can be no threads, or the part for them was not built, it is rejected with code `threads`, and `init` is what is left; `type` is the code of what is of another type.
 * The other codes: `config` for numbers out of their range and for a second call, `not-ready` where the compiled part cannot be loaded.
 *
 * A thread that ends before its time, for lack of memory say, ends the call that waits for it, and all later ones, with code `crashed`.
 */
export function initThreads(options?: ThreadsOptions): Promise<number>;
/** Why `initThreads` would be refused here, in words; `null` where nothing is known to be in its way. */
export function whyNoThreads(): string | null;
/** Whether `init` or `initThreads` has ended well, and the compiled part is alive. */
export function isReady(): boolean;
/** The package's version, the instruction set of its queries (`simd128` or `portable`), and the number of threads. */
export function about(): { version: string; instructionSet: string; threads: number };

export type Accuracy = "fast" | "watertight" | "exact";
export type Culling = "none" | "back" | "front";
export const ACCURACIES: readonly Accuracy[];
export const CULLINGS: readonly Culling[];
/** The `triangle` of a ray that hits nothing: 2^32 - 1. Its `t` is infinite. */
export const NONE: number;

/** Words of 32 bits in the memory of the compiled part. What is there need not be copied to be asked about. Free it after use. */
export class WasmArray {
    /** So many words, all 0. */
    constructor(length: number);
    readonly length: number;
    /** A view as floats. A view ends when the module's memory grows: read this property again after every call that makes something. */
    readonly floats: Float32Array;
    readonly words: Uint32Array;
    readonly bytes: Uint8Array;
    free(): void;
    [Symbol.dispose](): void;
}

export interface Watched {
    /**
     * Called now and then with what is being done, how much of it is, and how much there is (0: not known). `false` ends the work. An object that is
     * being changed by the work answers nothing meanwhile, and one that is being asked cannot be changed or freed: code `busy`.
     */
    progress?: (stage: string, done: number, total: number) => boolean | void;
    /**
     * Ends the work with code `cancelled`. A call that is not asynchronous keeps the event loop waiting: then only a signal that is aborted
     * before, or by `progress`, is seen.
     */
    signal?: AbortSignal;
}

export interface BuildOptions extends Watched {
    /** Speed of building against speed of queries; `fast` if left out, as in the Rust library. */
    preset?: "fast" | "narrow" | "balanced" | "best";
    /** `fast` if left out. `compact` takes a third to a half of the memory, and queries are slower. Answers are equal. */
    layout?: "fast" | "compact";
    /** Most bytes that the build may hold. */
    maxMemory?: number;
}

export interface QueryOptions extends Watched {
    /** `watertight` if left out. */
    accuracy?: Accuracy;
    /** Which side of triangles is ignored: `none` if left out. From the front a triangle's corners run counter-clockwise. */
    culling?: Culling;
    /** A triangle that is ignored. */
    ignore?: number;
}

/** Where the answers go instead of into new arrays; see each query for how many words it takes. */
export interface Into {
    into: WasmArray;
}

/** The closest hit of each ray. The point is `(1 - u - v) a + u b + v c` of the triangle's corners. */
export interface Hits {
    t: Float32Array;
    triangle: Uint32Array;
    u: Float32Array;
    v: Float32Array;
}

export interface Hit {
    t: number;
    triangle: number;
    u: number;
    v: number;
}

/** All crossings of rays with surfaces, in order along each ray; those of ray `i` are numbers `starts[i]` to `starts[i + 1] - 1`. */
export interface AllHits extends Hits {
    starts: Uint32Array;
    /** 1 where the ray comes from the front: where the corners run counter-clockwise. */
    front: Uint8Array;
}

export interface Windings {
    /** How often the surface winds around each point: 0 outside. */
    winding: Int32Array;
    /** 1 for points on the surface. */
    boundary: Uint8Array;
}

export interface ClosestPoints {
    /** Infinite where there is none. */
    distance: Float64Array;
    /** Three floats each. */
    point: Float32Array;
    triangle: Uint32Array;
    u: Float32Array;
    v: Float32Array;
}

export interface ClosestPointOptions extends Watched {
    /** Points farther away are not looked for. */
    maxDistance?: number;
    /** Both are the same for closest points; `exact` is not offered here, and refused. */
    accuracy?: "fast" | "watertight";
    /** A triangle that is ignored. */
    ignore?: number;
}

export interface LocateOptions extends Watched {
    /** Most bytes that the answers and the work on them may hold. */
    maxMemory?: number;
}

type Floats = Float32Array | WasmArray;
type Indices = Uint32Array | WasmArray | null;
type Vector = ArrayLike<number>;

/** A tree over a mesh. It has its own copy of all it needs. Free it after use. */
export class Tree {
    private constructor();
    /** `positions`: three floats a vertex. `indices`: three a triangle; without them every nine floats are a triangle. */
    static build(positions: Floats, indices?: Indices, options?: BuildOptions): Tree;
    /**
     * The same after the event loop has had a turn. The build itself is in one piece: it ends early by `progress` only, and to keep a page
     * alive meanwhile it belongs in a Worker, whose `terminate()` ends it at any time.
     */
    static buildAsync(positions: Floats, indices?: Indices, options?: BuildOptions): Promise<Tree>;
    /** A tree of the bytes that `toBytes` gave, over the same mesh. The bytes are checked and need not be trusted. */
    static load(bytes: Uint8Array, positions: Floats, indices?: Indices, options?: BuildOptions): Tree;
    /** Builds it again over other arrays, in the memory that it has. After an error it is what it was. */
    rebuild(positions: Floats, indices?: Indices, options?: BuildOptions): void;
    /** A tree file. The mesh is that of the build. */
    toBytes(positions: Floats, indices?: Indices): Uint8Array;
    /** Names the tree: 16 hexadecimal digits, the same on every machine. */
    readonly digest: string;
    readonly summary: {
        /** Of the mesh. */
        triangles: number;
        /** Triangles left out: a coordinate that is not finite, or two equal corners. */
        dropped: number;
        /** Triangles with a coordinate that became 0: -0, or one of less than 2^-126. */
        snapped: number;
        /** Most bytes that the build held, and bytes that queries need. */
        peakBytes: number;
        queryBytes: number;
        nodes: number;
        /** Entries of leaves: a triangle has one for each leaf that it reaches into. */
        references: number;
    };
    /** The box of all triangles that are kept. */
    readonly bounds: { min: Float32Array; max: Float32Array };

    /** `into`: 4 words a ray, t, triangle, u and v. */
    closestHits(rays: Floats, options?: QueryOptions): Hits;
    closestHits(rays: Floats, options: QueryOptions & Into): WasmArray;
    /** In slices of about 8 ms, with the event loop in between. */
    closestHitsAsync(rays: Floats, options?: QueryOptions): Promise<Hits>;
    closestHitsAsync(rays: Floats, options: QueryOptions & Into): Promise<WasmArray>;
    /** 1 for each ray that hits anything. `into`: a byte a ray. */
    anyHits(rays: Floats, options?: QueryOptions): Uint8Array;
    anyHits(rays: Floats, options: QueryOptions & Into): WasmArray;
    anyHitsAsync(rays: Floats, options?: QueryOptions): Promise<Uint8Array>;
    anyHitsAsync(rays: Floats, options: QueryOptions & Into): Promise<WasmArray>;
    /** Exact: each crossing of a surface once, also through edges. */
    allHits(rays: Floats, options?: Omit<QueryOptions, "accuracy"> & { maxMemory?: number }): AllHits;
    /** The closest hit of one ray, or `null`. */
    closestHit(origin: Vector, direction: Vector, options?: Omit<QueryOptions, keyof Watched> & { tMin?: number; tMax?: number }): Hit | null;
    anyHit(origin: Vector, direction: Vector, options?: Omit<QueryOptions, keyof Watched> & { tMin?: number; tMax?: number }): boolean;
    /** How often the surface winds around each point, exactly. `into`: 2 words a point. */
    windings(points: Floats, options?: LocateOptions): Windings;
    windings(points: Floats, options: LocateOptions & Into): WasmArray;
    windingsAsync(points: Floats, options?: LocateOptions): Promise<Windings>;
    windingsAsync(points: Floats, options: LocateOptions & Into): Promise<WasmArray>;
    /** 1 for each point inside or on a closed surface. */
    contains(points: Floats, options?: LocateOptions): Uint8Array;
    containsAsync(points: Floats, options?: LocateOptions): Promise<Uint8Array>;
    /** `into`: 8 words a point, the squared distance (a double), x, y, z, triangle, u, v. */
    closestPoints(points: Floats, options?: ClosestPointOptions): ClosestPoints;
    closestPoints(points: Floats, options: ClosestPointOptions & Into): WasmArray;
    closestPointsAsync(points: Floats, options?: ClosestPointOptions): Promise<ClosestPoints>;
    closestPointsAsync(points: Floats, options: ClosestPointOptions & Into): Promise<WasmArray>;
    free(): void;
    [Symbol.dispose](): void;
}

/** What trees on the CPU and on a GPU have in common. Answers are equal, bit for bit, where the GPU's parity is `bitwise`. */
export interface AnyTree {
    readonly digest: string;
    readonly summary: Tree["summary"];
    readonly bounds: Tree["bounds"];
    toBytes(positions: Floats, indices?: Indices): Uint8Array;
    closestHitsAsync(rays: Floats, options?: QueryOptions): Promise<Hits>;
    closestHitsAsync(rays: Floats, options: QueryOptions & Into): Promise<WasmArray>;
    anyHitsAsync(rays: Floats, options?: QueryOptions): Promise<Uint8Array>;
    anyHitsAsync(rays: Floats, options: QueryOptions & Into): Promise<WasmArray>;
    free(): void;
}

export interface GpuOptions {
    /** Seconds that opening the device, each shader that its driver compiles later, and each wait for it may take: 60 if left out. Software may need more. */
    timeout?: number;
    /** Ends the opening with code `cancelled`, at its end. */
    signal?: AbortSignal;
    /** Where the compiled part for WebGPU is, if not beside the package; as for `init`. */
    source?: Parameters<typeof init>[0];
}

/**
 * The GPU that the browser gives to a page or worker. Nothing here keeps the event loop waiting for it. Its compiled part, with memory of its
 * own, is loaded by the first `open`; `init` must have ended before.
 */
export class Gpu {
    private constructor();
    /**
     * Opens the device and tests it: arithmetic, two small trees, and rays through them, against the bits of the CPU. Rejected with code
     * `no-webgpu`, `device`, `device-lost` or `timed-out`. With `hardware` an adapter that is software is none.
     */
    static open(options?: GpuOptions & { hardware?: boolean }): Promise<Gpu>;
    /** What the browser calls it; often not more than a vendor and a family. */
    readonly adapter: string;
    /** Whether it is software, which runs on the CPU. */
    readonly isSoftware: boolean;
    /** `bitwise`: trees and watertight hits are those of the CPU. */
    readonly parity: "bitwise" | "structural";
    /** What differs, in words, where the parity is `structural`. */
    readonly difference: string | null;
    /** Why the device is gone; `null` while it is there. Then open another one, or go on with the CPU. */
    readonly lost: string | null;
    /** Presets `fast`, `narrow` and `balanced`. `progress` and `signal` end it at any time; `layout` has no meaning here. */
    build(positions: Floats, indices?: Indices, options?: BuildOptions): Promise<GpuTree>;
    /** A scene of instances that answers on this device. */
    scene(): GpuScene;
    /** Gives the device back. Its trees keep digest, summary and `toBytes`, and answer no rays. */
    free(): void;
    [Symbol.dispose](): void;
}

/** A tree on a GPU, with a copy of it beside. `progress` and `signal` end queries at any time. Free it after use. */
export class GpuTree implements AnyTree {
    private constructor();
    readonly digest: string;
    readonly summary: Tree["summary"];
    readonly bounds: Tree["bounds"];
    /** A tree file, for `Tree.load`: also after the device was lost. */
    toBytes(positions: Floats, indices?: Indices): Uint8Array;
    closestHitsAsync(rays: Floats, options?: QueryOptions): Promise<Hits>;
    closestHitsAsync(rays: Floats, options: QueryOptions & Into): Promise<WasmArray>;
    anyHitsAsync(rays: Floats, options?: QueryOptions): Promise<Uint8Array>;
    anyHitsAsync(rays: Floats, options: QueryOptions & Into): Promise<WasmArray>;
    /**
     * Exact: each crossing of a surface once, also through edges. The device lists triangles; which of them are crossed is decided on the CPU, in one piece
     * for each 65,536 rays.
     */
    allHitsAsync(rays: Floats, options?: Omit<QueryOptions, "accuracy"> & { maxMemory?: number }): Promise<AllHits>;
    free(): void;
    [Symbol.dispose](): void;
}

export const BACKENDS: readonly ["auto", "cpu", "gpu"];

/** CPU or GPU behind one choice. */
export class Backend {
    private constructor();
    /**
     * `auto` takes a GPU that is hardware and whose parity is `bitwise`, else the CPU, and `reason` says why. `gpu` takes what the browser
     * gives, and is rejected as `Gpu.open` is.
     */
    static open(name?: "auto" | "cpu" | "gpu", options?: GpuOptions): Promise<Backend>;
    readonly name: "cpu" | "gpu";
    /** `null` on the CPU. */
    readonly gpu: Gpu | null;
    readonly reason: string;
    /** Builds a tree. Where `auto` has taken a GPU, preset `best` is built on the CPU, which alone can. */
    build(positions: Floats, indices?: Indices, options?: BuildOptions): Promise<AnyTree>;
    /** A scene of instances. */
    scene(): AnyScene;
    free(): void;
    [Symbol.dispose](): void;
}

export interface SceneHits extends Hits {
    geometry: Uint32Array;
    instance: Uint32Array;
}

export interface SceneQueryOptions extends Watched {
    accuracy?: Accuracy;
    /** As seen in the world. */
    culling?: Culling;
    /** Instances answer when a bit of their mask is in it: all bits if left out. */
    mask?: number;
    ignore?: { instance: number; triangle: number };
}

/** What scenes on the CPU and on a GPU have in common. */
export interface AnyScene {
    /** A copy of a mesh; its name. */
    addGeometry(positions: Floats, indices?: Indices): number;
    /** One without instances. */
    removeGeometry(geometry: number): void;
    /** `matrix`: from the object to the world; 12 numbers by rows, or 16 by columns as in three.js. Its name. */
    addInstance(geometry: number, matrix: ArrayLike<number>, options?: { mask?: number; culling?: Culling }): number;
    moveInstance(instance: number, matrix: ArrayLike<number>): void;
    removeInstance(instance: number): void;
    /** Builds what changed. */
    updateAsync(options?: BuildOptions): Promise<void>;
    readonly digest: string;
    closestHitsAsync(rays: Floats, options?: SceneQueryOptions): Promise<SceneHits>;
    closestHitsAsync(rays: Floats, options: SceneQueryOptions & Into): Promise<WasmArray>;
    anyHitsAsync(rays: Floats, options?: SceneQueryOptions): Promise<Uint8Array>;
    anyHitsAsync(rays: Floats, options: SceneQueryOptions & Into): Promise<WasmArray>;
    free(): void;
}

/**
 * Meshes and instances of them on a GPU. Accuracy is `watertight`: others are refused with code `config`. While an update is under way edits and queries are refused with
 * code `busy`, as is an update while rays are. After an update that failed it answers as before it, and keeps the edits. Free it after use.
 */
export class GpuScene implements AnyScene {
    private constructor();
    addGeometry(positions: Floats, indices?: Indices): number;
    removeGeometry(geometry: number): void;
    addInstance(geometry: number, matrix: ArrayLike<number>, options?: { mask?: number; culling?: Culling }): number;
    moveInstance(instance: number, matrix: ArrayLike<number>): void;
    removeInstance(instance: number): void;
    updateAsync(options?: BuildOptions): Promise<void>;
    readonly digest: string;
    closestHitsAsync(rays: Floats, options?: SceneQueryOptions): Promise<SceneHits>;
    closestHitsAsync(rays: Floats, options: SceneQueryOptions & Into): Promise<WasmArray>;
    anyHitsAsync(rays: Floats, options?: SceneQueryOptions): Promise<Uint8Array>;
    anyHitsAsync(rays: Floats, options: SceneQueryOptions & Into): Promise<WasmArray>;
    free(): void;
    [Symbol.dispose](): void;
}

/** Meshes and instances of them. Edit it, `update` it, ask it. After an update that failed it answers as before it, and keeps the edits. Free it after use. */
export class Scene implements AnyScene {
    constructor();
    /** A copy of a mesh; its name. */
    addGeometry(positions: Floats, indices?: Indices): number;
    /** One without instances. */
    removeGeometry(geometry: number): void;
    /** `matrix`: from the object to the world; 12 numbers by rows, or 16 by columns as in three.js. Its name. */
    addInstance(geometry: number, matrix: ArrayLike<number>, options?: { mask?: number; culling?: Culling }): number;
    moveInstance(instance: number, matrix: ArrayLike<number>): void;
    removeInstance(instance: number): void;
    /** Builds what changed. */
    update(options?: BuildOptions): void;
    /** The same after the event loop has had a turn; the work itself is in one piece. */
    updateAsync(options?: BuildOptions): Promise<void>;
    readonly digest: string;
    /** `into`: 6 words a ray, t, u, v, triangle, geometry and instance. */
    closestHits(rays: Floats, options?: SceneQueryOptions): SceneHits;
    closestHits(rays: Floats, options: SceneQueryOptions & Into): WasmArray;
    closestHitsAsync(rays: Floats, options?: SceneQueryOptions): Promise<SceneHits>;
    closestHitsAsync(rays: Floats, options: SceneQueryOptions & Into): Promise<WasmArray>;
    anyHits(rays: Floats, options?: SceneQueryOptions): Uint8Array;
    anyHits(rays: Floats, options: SceneQueryOptions & Into): WasmArray;
    anyHitsAsync(rays: Floats, options?: SceneQueryOptions): Promise<Uint8Array>;
    anyHitsAsync(rays: Floats, options: SceneQueryOptions & Into): Promise<WasmArray>;
    free(): void;
    [Symbol.dispose](): void;
}
