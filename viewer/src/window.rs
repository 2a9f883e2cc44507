//! The window: its events, and when it is drawn.

use super::area;
use super::blit::Place;
use super::error::ViewerError;
use super::paint::{Content, Painter};
use super::panel;
use super::screen::{Acquired, Screen};
use super::source::{FirstFrame, FrameSource};
use super::state::State;
use super::worker::{News, Worker};
use super::{Ended, Settings};
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::window::{Window, WindowId};

/// A surface that cannot be drawn on so often in a row never will be.
const MOST_RETRIES: u32 = 200;
/// Between two tries.
const RETRY: Duration = Duration::from_millis(10);

/// What happens elsewhere and concerns the window.
#[derive(Debug)]
pub(super) enum Event {
    /// From the thread that makes the pictures.
    News(News),
    /// The device is gone.
    Lost(String),
    /// wgpu or the driver refused something.
    Refused(String),
}

/// The program while its window is open.
pub(super) struct App {
    settings: Settings,
    source: Option<Box<dyn FrameSource>>,
    proxy: EventLoopProxy<Event>,
    open: Option<Open>,
    /// How it ends.
    pub(super) outcome: Result<Ended, ViewerError>,
}

/// An open window. The thread is dropped, and so ended, before the device it uses.
struct Open {
    worker: Worker,
    state: State,
    egui: egui_winit::State,
    painter: Painter,
    screen: Screen,
    window: Arc<Window>,
    /// When to draw next although nothing happens.
    wake: Option<Instant>,
    /// When it was drawn last.
    drawn: Instant,
    retries: u32,
    /// Frames shown that were finished.
    finished: u32,
}

/// Whether to go on after a frame, or how the window ends.
type After = std::ops::ControlFlow<Ended>;

impl App {
    pub(super) fn new(
        settings: Settings,
        source: Box<dyn FrameSource>,
        proxy: EventLoopProxy<Event>,
    ) -> App {
        let outcome = Ok(Ended::default());
        App { settings, source: Some(source), proxy, open: None, outcome }
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<(), ViewerError> {
        let Some(source) = self.source.take() else { return Ok(()) };
        let [width, height] = self.settings.size;
        let attributes = Window::default_attributes()
            .with_title("splitplane")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_min_inner_size(LogicalSize::new(panel::WIDTH + 160.0, 240.0));
        let window = event_loop
            .create_window(attributes)
            .map_err(|error| ViewerError::Window(error.to_string()))?;
        let window = Arc::new(window);
        let display = event_loop.owned_display_handle();
        let adapter = self.settings.adapter.as_deref();
        let screen = Screen::open(display, Arc::clone(&window), adapter)?;
        let device = &screen.gpu.device;
        let proxy = self.proxy.clone();
        device.set_device_lost_callback(move |reason, message| {
            // The window lets go of the device by itself when it ends.
            if reason != wgpu::DeviceLostReason::Destroyed {
                let _ = proxy.send_event(Event::Lost(message));
            }
        });
        let proxy = self.proxy.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = proxy.send_event(Event::Refused(error.to_string()));
        }));
        let painter = Painter::new(device, screen.format());
        let context = egui::Context::default();
        panel::style(&context);
        let egui = egui_winit::State::new(
            context,
            egui::ViewportId::ROOT,
            window.as_ref(),
            Some(window.scale_factor() as f32),
            Some(winit::window::Theme::Dark),
            Some(device.limits().max_texture_dimension_2d as usize),
        );
        let beside = f64::from(panel::WIDTH) * window.scale_factor();
        let aspect = (f64::from(width) - beside).max(1.0) / f64::from(height.max(1));
        let choices = self.settings.choices();
        let first = FirstFrame { backend: choices.backend, preset: choices.preset, aspect };
        let proxy = self.proxy.clone();
        let tell = move |news| {
            // Nobody listens when the window is gone already.
            let _ = proxy.send_event(Event::News(news));
        };
        let worker = Worker::start(source, screen.gpu.clone(), first, tell)
            .map_err(|error| ViewerError::Window(format!("no thread can be started: {error}")))?;
        window.request_redraw();
        self.open = Some(Open {
            worker,
            state: State::new(choices),
            egui,
            painter,
            screen,
            window,
            wake: None,
            drawn: Instant::now(),
            retries: 0,
            finished: 0,
        });
        Ok(())
    }

    fn end(&mut self, event_loop: &ActiveEventLoop, outcome: Result<Ended, ViewerError>) {
        self.outcome = outcome;
        if let Some(open) = self.open.take() {
            // What the thread is at may take a while; nobody needs to watch that.
            open.window.set_visible(false);
        }
        event_loop.exit();
    }

    /// What the last frame said, for whoever asks after the end.
    fn ended(&self) -> Ended {
        let frame = self.open.as_ref().and_then(|open| open.state.frame.as_ref());
        Ended { report: frame.map(|frame| frame.report.clone()), screenshot: None }
    }

    fn redraw(&mut self, event_loop: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        match open.redraw(&self.settings) {
            Ok(After::Continue(())) => {}
            Ok(After::Break(ended)) => self.end(event_loop, Ok(ended)),
            Err(error) => self.end(event_loop, Err(error)),
        }
    }
}

impl ApplicationHandler<Event> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if let Err(error) = self.open(event_loop) {
            self.end(event_loop, Err(error));
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, event: Event) {
        let Some(open) = &mut self.open else { return };
        let failed = match event {
            Event::News(News::Opened(opening)) => {
                open.window.set_title(&format!("splitplane: {}", opening.scene));
                open.state.open(*opening);
                None
            }
            Event::News(News::Frame(frame)) => {
                open.state.show(*frame);
                None
            }
            Event::News(News::Failed(error)) => {
                open.state.fail(&error);
                // Without a single frame there is nothing to go back to.
                let fatal = error.is_device_loss() || open.state.frame.is_none();
                fatal.then_some(ViewerError::Frame(error))
            }
            Event::News(News::NotOpened(error)) => Some(ViewerError::Frame(error)),
            Event::Lost(reason) => Some(ViewerError::DeviceLost(reason)),
            Event::Refused(reason) => Some(ViewerError::Device(reason)),
        };
        match failed {
            Some(error) => self.end(event_loop, Err(error)),
            None => open.window.request_redraw(),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.open else { return };
        let response = open.egui.on_window_event(&open.window, &event);
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => {
                let ended = self.ended();
                self.end(event_loop, Ok(ended));
            }
            WindowEvent::Resized(size) => {
                open.screen.resize(size.width, size.height);
                open.window.request_redraw();
            }
            WindowEvent::Occluded(false) => open.window.request_redraw(),
            WindowEvent::RedrawRequested => self.redraw(event_loop),
            _ if response.repaint => open.window.request_redraw(),
            _ => {}
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(open) = &mut self.open else { return };
        let flow = match open.wake {
            Some(wake) if wake <= Instant::now() => {
                open.wake = None;
                open.window.request_redraw();
                ControlFlow::Wait
            }
            Some(wake) => ControlFlow::WaitUntil(wake),
            None => ControlFlow::Wait,
        };
        event_loop.set_control_flow(flow);
    }
}

impl Open {
    fn redraw(&mut self, settings: &Settings) -> Result<After, ViewerError> {
        self.wake = None;
        let Some(size) = self.screen.size() else { return Ok(After::Continue(())) };
        let input = self.egui.take_egui_input(&self.window);
        let context = self.egui.egui_ctx().clone();
        let state = &mut self.state;
        let now = Instant::now();
        state.advance(now.duration_since(self.drawn).as_secs_f64());
        self.drawn = now;
        let mut rect = egui::Rect::ZERO;
        let output = context.run_ui(input, |ui| {
            area::keys(ui, state);
            if state.shows_panel {
                let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(12);
                egui::Panel::right("panel")
                    .exact_size(panel::WIDTH)
                    .resizable(false)
                    .frame(frame)
                    .show(ui, |ui| panel::show(ui, state));
            }
            egui::CentralPanel::no_frame().show(ui, |ui| rect = area::show(ui, state));
            panel::keys(&context, state);
        });
        let delay = output
            .viewport_output
            .get(&egui::ViewportId::ROOT)
            .map_or(Duration::MAX, |viewport| viewport.repaint_delay);
        self.egui.handle_platform_output(&self.window, output.platform_output);
        let points = output.pixels_per_point;
        let place = place_of(rect, points, size);
        if let Some(place) = place
            && let Some(job) = self.state.wants([place.width, place.height])
        {
            self.worker.ask(job);
        }
        let interface = context.tessellate(output.shapes, points);
        let mut textures = output.textures_delta;
        self.painter.take_textures(&self.screen.gpu, &mut textures);
        let frame = self.state.frame.clone();
        let picture = frame.as_ref().map(|frame| frame.picture.as_ref()).zip(place);
        let content = Content { picture, interface: &interface, size, points };
        let acquired = self.screen.acquire()?;
        let shown = match acquired {
            Acquired::Texture(texture) => {
                self.painter.draw(&self.screen.gpu, &texture.texture, &content);
                self.window.pre_present_notify();
                self.screen.gpu.queue.present(texture);
                self.retries = 0;
                true
            }
            Acquired::Later => {
                self.retries += 1;
                if self.retries > MOST_RETRIES {
                    let reason = "the window cannot be drawn on".to_owned();
                    return Err(ViewerError::Device(reason));
                }
                self.wake = Instant::now().checked_add(RETRY);
                false
            }
            Acquired::Hidden => false,
        };
        let after = self.count(shown, settings, &content)?;
        self.painter.free_textures(&mut textures);
        let settles = self.state.settles_in();
        self.sleep(delay, settles, settings);
        Ok(after)
    }

    /// Counts frames where the user has given a number of them, and ends after the last.
    fn count(
        &mut self,
        shown: bool,
        settings: &Settings,
        content: &Content<'_>,
    ) -> Result<After, ViewerError> {
        let Some(frames) = settings.frames else { return Ok(After::Continue(())) };
        if !shown || !self.state.is_finished() {
            return Ok(After::Continue(()));
        }
        self.finished += 1;
        if self.finished < frames {
            return Ok(After::Continue(()));
        }
        let report = self.state.frame.as_ref().map(|frame| frame.report.clone());
        let screenshot = if settings.screenshot {
            let shot = self.painter.screenshot(&self.screen.gpu, content);
            Some(shot.map_err(ViewerError::Screenshot)?)
        } else {
            None
        };
        Ok(After::Break(Ended { report, screenshot }))
    }

    /// Sets when to draw next although nothing happens.
    fn sleep(&mut self, delay: Duration, settles: Option<Duration>, settings: &Settings) {
        let counting = settings.frames.is_some() && self.state.is_finished();
        let waits = [
            Some(delay).filter(|delay| *delay < Duration::MAX),
            settles,
            (counting || self.state.playing).then_some(Duration::ZERO),
        ];
        let next = waits.into_iter().flatten().min();
        if next == Some(Duration::ZERO) {
            self.window.request_redraw();
        } else if let Some(at) = next.and_then(|wait| Instant::now().checked_add(wait)) {
            self.wake = Some(self.wake.map_or(at, |wake| wake.min(at)));
        }
    }
}

/// The pixels of the window that a rectangle in points covers; `None` when there are none.
fn place_of(rect: egui::Rect, points: f32, [width, height]: [u32; 2]) -> Option<Place> {
    let pixel = |at: f32, most: u32| ((at * points).round().max(0.0) as u32).min(most);
    let (left, right) = (pixel(rect.left(), width), pixel(rect.right(), width));
    let (top, bottom) = (pixel(rect.top(), height), pixel(rect.bottom(), height));
    let place =
        Place { left, top, width: right.saturating_sub(left), height: bottom.saturating_sub(top) };
    (place.width > 0 && place.height > 0).then_some(place)
}
