// A thread of the package, in a worker of Node.

import { parentPort } from "node:worker_threads";

import * as raw from "../pkg/threads/splitplane_threads.js";
import { runThread } from "./pool.js";

parentPort.once("message", (told) => runThread(raw, told, (answer) => parentPort.postMessage(answer)));
