// A thread of the page's compiled part.

import * as raw from "./pkg/threads/splitplane_threads.js";
import { runThread } from "./pool.js";

onmessage = ({ data }) => runThread(raw, data, (told) => postMessage(told));
