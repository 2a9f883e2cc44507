//! The thread that makes the pictures, so that the window never waits for one.

use super::blit::Picture;
use super::boxes::LevelBoxes;
use super::source::{
    FirstFrame, FrameDevice, FrameError, FrameReport, FrameRequest, FrameSource, FrameTarget,
    Opening,
};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// What the window wants to show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Job {
    pub(super) request: FrameRequest,
    /// The depth of the boxes to show.
    pub(super) level: Option<u32>,
    /// How many pixels of the window a pixel of the picture takes on a side; 1 for a whole picture.
    pub(super) step: u32,
    /// Made to be seen for a moment, while something moves. Such a frame is finished even when a
    /// later one is asked for: else a steady hand would never see one.
    pub(super) fleeting: bool,
}

/// What there is to show.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    pub(super) job: Job,
    pub(super) picture: Arc<Picture>,
    pub(super) report: FrameReport,
    pub(super) boxes: Option<Arc<LevelBoxes>>,
}

/// What the thread tells the window.
#[derive(Debug)]
pub(super) enum News {
    /// The source is open.
    Opened(Box<Opening>),
    /// A frame is there.
    Frame(Box<Frame>),
    /// The latest job failed; the last frame stays. Nothing is said of superseded ones.
    Failed(FrameError),
    /// The source cannot be opened: there will be no frame.
    NotOpened(FrameError),
}

/// What the window and the thread share.
#[derive(Debug, Default)]
struct Shared {
    inbox: Mutex<Inbox>,
    changed: Condvar,
    superseded: AtomicBool,
}

#[derive(Debug, Default)]
struct Inbox {
    next: Option<Job>,
    /// Whether the frame that is being made may be given up for another.
    expendable: bool,
    closed: bool,
}

impl Shared {
    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread. Dropping it ends the thread, after the frame it is at.
#[derive(Debug)]
pub(super) struct Worker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread. It opens the source and then makes the latest frame that is wanted; `tell`
    /// runs on the thread.
    pub(super) fn start(
        source: Box<dyn FrameSource>,
        gpu: FrameDevice,
        first: FirstFrame,
        tell: impl Fn(News) + Send + 'static,
    ) -> std::io::Result<Worker> {
        let shared = Arc::new(Shared::default());
        let maker =
            Maker { source, gpu, shared: Arc::clone(&shared), pictures: Vec::new(), last: None };
        let thread = std::thread::Builder::new()
            .name("frames".into())
            .spawn(move || maker.run(&first, &tell))?;
        Ok(Worker { shared, thread: Some(thread) })
    }

    /// Asks for a frame; one that was asked for before and has not been begun is forgotten.
    pub(super) fn ask(&self, job: Job) {
        let mut inbox = self.shared.inbox();
        inbox.next = Some(job);
        if inbox.expendable {
            self.shared.superseded.store(true, Ordering::Relaxed);
        }
        drop(inbox);
        self.shared.changed.notify_one();
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.shared.inbox().closed = true;
        self.shared.superseded.store(true, Ordering::Relaxed);
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been reported where it happened.
            let _ = thread.join();
        }
    }
}

/// How long a frame that is out is left alone before it is asked for.
const ASK: Duration = Duration::from_micros(500);

/// What the thread does next.
enum Step {
    /// Start on this frame.
    Begin(Job),
    /// Tell of the frame that is out.
    Finish,
}

/// A frame that was begun.
struct Begun {
    job: Job,
    picture: Arc<Picture>,
    /// The last frame, where it is of the same request: nothing was submitted.
    same: Option<Frame>,
}

/// What runs on the thread.
struct Maker {
    source: Box<dyn FrameSource>,
    gpu: FrameDevice,
    shared: Arc<Shared>,
    /// Room for pictures; those that the window holds are in use.
    pictures: Vec<Arc<Picture>>,
    last: Option<Frame>,
}

impl Maker {
    fn run(mut self, first: &FirstFrame, tell: &dyn Fn(News)) {
        match self.source.open(&self.gpu, first) {
            Ok(opening) => tell(News::Opened(Box::new(opening))),
            Err(error) => return tell(News::NotOpened(error)),
        }
        let mut out: Option<Begun> = None;
        while let Some(step) = self.next(out.is_some()) {
            match step {
                Step::Finish => self.deliver(out.take(), tell),
                Step::Begin(job) => {
                    // Boxes are those of the tree that is there; and a frame of the same request is not made twice.
                    let is_last =
                        self.last.as_ref().is_some_and(|last| last.job.request == job.request);
                    let waits = out.as_ref().is_some_and(|begun| {
                        is_last || begun.job.level.is_some() || begun.job.request == job.request
                    });
                    if waits {
                        self.deliver(out.take(), tell);
                    }
                    match self.begin(&job) {
                        Ok(begun) => {
                            let before = out.replace(begun);
                            self.deliver(before, tell);
                        }
                        Err(FrameError::Superseded) => {}
                        Err(error) => tell(News::Failed(error)),
                    }
                }
            }
        }
    }

    /// Waits for the next job, or for the end of the frame that is out; `None` when the window is gone.
    fn next(&mut self, is_out: bool) -> Option<Step> {
        loop {
            let mut inbox = self.shared.inbox();
            inbox.expendable = false;
            loop {
                if inbox.closed {
                    return None;
                }
                if let Some(job) = inbox.next.take() {
                    inbox.expendable = !job.fleeting;
                    self.shared.superseded.store(false, Ordering::Relaxed);
                    return Some(Step::Begin(job));
                }
                if is_out {
                    break;
                }
                let woken = self.shared.changed.wait(inbox);
                inbox = woken.unwrap_or_else(PoisonError::into_inner);
            }
            drop(inbox);
            if self.source.is_done() {
                return Some(Step::Finish);
            }
            let inbox = self.shared.inbox();
            // The device tells nobody that it is done: it is asked.
            if inbox.next.is_none() && !inbox.closed {
                let _ = self.shared.changed.wait_timeout(inbox, ASK);
            }
        }
    }

    /// Starts on a frame, or takes the last one where it will do.
    fn begin(&mut self, job: &Job) -> Result<Begun, FrameError> {
        // Other boxes alone need no other picture.
        if let Some(last) = self.last.take().filter(|last| last.job.request == job.request) {
            let picture = Arc::clone(&last.picture);
            return Ok(Begun { job: *job, picture, same: Some(last) });
        }
        let picture = self.room(job.request.width, job.request.height);
        let target = FrameTarget::new(&self.gpu, &picture.pixels, &self.shared.superseded);
        self.source.submit(&job.request, &target)?;
        Ok(Begun { job: *job, picture, same: None })
    }

    /// Tells of a frame when it is done.
    fn deliver(&mut self, begun: Option<Begun>, tell: &dyn Fn(News)) {
        let Some(begun) = begun else { return };
        match self.complete(begun) {
            Ok(frame) => {
                self.last = Some(frame.clone());
                tell(News::Frame(Box::new(frame)));
            }
            Err(error) => tell(News::Failed(error)),
        }
    }

    fn complete(&mut self, Begun { job, picture, same }: Begun) -> Result<Frame, FrameError> {
        let (report, old_boxes) = match same {
            Some(Frame { job: of, report, boxes, .. }) => {
                let boxes = boxes.filter(|_| of.level == job.level);
                (FrameReport { build_ms: None, ..report }, boxes)
            }
            None => (self.source.finish()?, None),
        };
        let boxes = match (old_boxes, job.level, self.source.tree()) {
            (Some(boxes), ..) => Some(boxes),
            (None, Some(level), Some(tree)) => Some(Arc::new(LevelBoxes::of(&tree.view(), level))),
            _ => None,
        };
        Ok(Frame { job, picture, report, boxes })
    }

    /// A picture of this size that nobody looks at. Those of other sizes are let go.
    fn room(&mut self, width: u32, height: u32) -> Arc<Picture> {
        self.pictures.retain(|old| (old.width, old.height) == (width, height));
        let free = self.pictures.iter().find(|old| Arc::strong_count(old) == 1);
        if let Some(picture) = free {
            return Arc::clone(picture);
        }
        let picture = Arc::new(Picture::new(&self.gpu.device, width, height));
        self.pictures.push(Arc::clone(&picture));
        picture
    }
}
