/** Every error of the package. `code` says what kind it is, `message` is the library's text. */
export class SplitplaneError extends Error {
    /**
     * @param {string} code one of `CODES`
     * @param {string} message
     * @param {{cause?: unknown}} [options]
     */
    constructor(code, message, options) {
        super(message, options);
        this.name = "SplitplaneError";
        this.code = code;
    }
}

/** What `code` can be. */
export const CODES = Object.freeze([
    "not-ready", // init() has not been awaited
    "type", // an argument of another type
    "shape", // an array of a length that it cannot have
    "config", // an option out of its range, or a name that does not exist
    "mesh", // indices out of range, or too many triangles
    "freed", // an object after its free()
    "busy", // an object, called by its own progress callback
    "cancelled", // by a progress callback or an AbortSignal, whose reason is `cause`
    "out-of-memory", // a limit, or what the module may have
    "wrong-mesh", // a tree of another mesh
    "file", // bytes that are not a tree file
    "unknown", // no geometry or instance of this name
    "stale", // a scene that was edited, and for which no update was tried since
    "scene", // a scene that cannot be
    "threads", // there can be no threads here: the page is not isolated, or it is a window's own thread
    "no-webgpu", // a browser without WebGPU, or without an adapter for it
    "device-lost", // the GPU's device is gone; open another one, or go on with the CPU
    "timed-out", // the GPU, or its driver, takes longer than it may
    "device", // something else that the GPU cannot do
    "build",
    "query",
    "crashed", // the module has ended; load the page, or start the worker, anew
]);
