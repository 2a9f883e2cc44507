// Workers of Node, as pool.js takes them.

import { Worker } from "node:worker_threads";

/** A worker that runs the script at `url`. */
export function nodeWorker(url) {
    const worker = new Worker(url);
    let isEnding = false;
    return {
        post: (told) => worker.postMessage(told),
        hear(message, failed) {
            worker.on("message", (told) => {
                // Threads that wait for work keep no program from its end.
                worker.unref();
                message(told);
            });
            worker.on("error", (error) => failed(error.message));
            worker.on("exit", (code) => isEnding || failed(`a worker has ended with status ${code}`));
        },
        end() {
            isEnding = true;
            worker.terminate();
        },
    };
}
