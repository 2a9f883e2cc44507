// A thread with a planted fault: its compiled part fails when it first asks for the time, which it does to tell of progress.

import "data:text/javascript,Date.now = () => { throw new Error('planted'); };";
import "/js/threads-worker.js";
