//! Turns: everyone answers the same rays, again and again.

use std::time::{Duration, Instant};

use splitplane_core::ray::Ray;

use crate::callgrind;

/// Distance (infinity for none) and triangle of each ray's hit.
pub(crate) type Answers = [(f32, u32)];

/// Writes an answer for each ray.
type Answering<'a, A> = Box<dyn Fn(&[Ray], &mut A) + 'a>;

/// Makes ready for rays.
type Ready<'a> = Box<dyn Fn(&[Ray]) + 'a>;

/// Someone who answers rays.
pub(crate) struct Contestant<'a> {
    pub name: String,
    /// What is done before each turn, and in no time.
    pub ready: Ready<'a>,
    pub closest: Answering<'a, Answers>,
    pub any: Answering<'a, [bool]>,
}

/// Rays of a million that may be answered differently: those that graze an edge, or start on a surface.
const DIFFERENT: usize = 1000;

/// Prints, for closest hits and any hits, everyone's median time in ns a ray, and the median over the rounds of the first
/// one's time over theirs.
///
/// # Errors
/// Where answers differ from the first one's by more than grazing rays account for.
pub(crate) fn contest(
    set: &str,
    rays: &[Ray],
    all: &[Contestant<'_>],
    rounds: usize,
    tolerance: f32,
) -> Result<(), String> {
    let mut found = vec![vec![(f32::INFINITY, u32::MAX); rays.len()]; all.len()];
    let mut hit = vec![vec![false; rays.len()]; all.len()];
    let mut ready = |i: usize| (all[i].ready)(rays);
    let mut closest = |i: usize| (all[i].closest)(rays, &mut found[i]);
    let seconds = times(all.len(), rounds, &mut ready, &mut closest);
    print(&format!("{set} closest"), rays.len(), all, &seconds);
    let mut any = |i: usize| (all[i].any)(rays, &mut hit[i]);
    let seconds = times(all.len(), rounds, &mut ready, &mut any);
    print(&format!("{set} any"), rays.len(), all, &seconds);
    for (i, one) in all.iter().enumerate() {
        let far = |a: f32, b: f32| a.is_finite() != b.is_finite() || (a - b).abs() > tolerance;
        let pairs = found[0].iter().zip(&found[i]);
        let closest = pairs.filter(|(a, b)| far(a.0, b.0)).count();
        let any = hit[0].iter().zip(&hit[i]).filter(|(a, b)| a != b).count();
        if closest.max(any) * 1_000_000 > DIFFERENT * rays.len() {
            return Err(format!(
                "{set}: of {} rays {} answers {closest} closest and {any} any hits differently",
                rays.len(),
                one.name
            ));
        }
    }
    Ok(())
}

/// Has everyone answer the rays under callgrind, which writes a file of counts for each.
pub(crate) fn count(scene: &str, set: &str, rays: &[Ray], all: &[Contestant<'_>]) {
    let mut found = vec![(f32::INFINITY, u32::MAX); rays.len()];
    let mut hit = vec![false; rays.len()];
    for one in all {
        let name = |query: &str| format!("{scene} {set} {query} {}: {} rays", one.name, rays.len());
        let ready = || (one.ready)(rays);
        callgrind::count(&name("closest"), ready, || (one.closest)(rays, &mut found));
        callgrind::count(&name("any"), ready, || (one.any)(rays, &mut hit));
    }
}

/// Seconds of everyone in each round; for the first one the mean of a turn at the start and one at the end.
pub(crate) fn times(
    count: usize,
    rounds: usize,
    ready: &mut dyn FnMut(usize),
    work: &mut dyn FnMut(usize),
) -> Vec<Vec<f64>> {
    for i in 0..count {
        ready(i);
        work(i);
    }
    let mut round = |number: usize| {
        let mut seconds = vec![0.0; count];
        let mut timed = |i: usize| {
            ready(i);
            let before = cpu_time();
            work(i);
            (cpu_time() - before).as_secs_f64()
        };
        let first = timed(0);
        for place in 1..count {
            // In another order each time.
            let i = 1 + (place + number) % (count - 1);
            seconds[i] = timed(i);
        }
        seconds[0] = 0.5 * (first + timed(0));
        seconds
    };
    (0..rounds.max(1)).map(&mut round).collect()
}

fn print(what: &str, rays: usize, all: &[Contestant<'_>], rounds: &[Vec<f64>]) {
    print!("  {what:<16}");
    for (i, one) in all.iter().enumerate() {
        let ns = median(rounds.iter().map(|round| round[i] / rays as f64 * 1e9));
        print!("  {} {ns:.1} ns", one.name);
        if i > 0 {
            print!(", {:.2}", median(rounds.iter().map(|round| round[0] / round[i])));
        }
    }
    println!();
}

pub(crate) fn median(numbers: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = numbers.collect();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 { sorted[middle] } else { 0.5 * (sorted[middle - 1] + sorted[middle]) }
}

/// What something took, in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Took {
    /// CPU time of all threads.
    pub cpu: f64,
    /// Time that passed.
    pub wall: f64,
}

/// Measures some work.
pub(crate) fn took<T>(work: impl FnOnce() -> T) -> (Took, T) {
    let (start, before) = (Instant::now(), cpu_time());
    let done = work();
    let cpu = (cpu_time() - before).as_secs_f64();
    (Took { cpu, wall: start.elapsed().as_secs_f64() }, done)
}

/// CPU time of this process. Under Valgrind always 0: there nothing is timed, and the system's quick way to the clock cannot be taken.
#[cfg(unix)]
pub(crate) fn cpu_time() -> Duration {
    if callgrind::is_here() {
        return Duration::ZERO;
    }
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    let [seconds, nanoseconds] =
        [time.tv_sec, time.tv_nsec].map(|part| u64::try_from(part).unwrap_or(0));
    Duration::from_secs(seconds) + Duration::from_nanos(nanoseconds)
}

/// Time, where the system's CPU time is not at hand.
#[cfg(not(unix))]
pub(crate) fn cpu_time() -> Duration {
    static START: std::sync::LazyLock<std::time::Instant> =
        std::sync::LazyLock::new(std::time::Instant::now);
    START.elapsed()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn same(t: f32) -> Contestant<'static> {
        Contestant {
            name: format!("all at {t}"),
            ready: Box::new(|_| ()),
            closest: Box::new(move |_, hits| hits.fill((t, 0))),
            any: Box::new(|_, hits| hits.fill(true)),
        }
    }

    #[test]
    fn other_answers_end_the_contest() {
        let rays = [Ray::new([0.0; 3], [1.0; 3])];
        assert!(contest("set", &rays, &[same(1.0), same(1.0)], 1, 0.1).is_ok());
        let error = contest("set", &rays, &[same(1.0), same(2.0)], 1, 0.1).unwrap_err();
        assert!(error.contains("all at 2 answers 1 closest and 0 any"), "{error}");
    }

    #[test]
    fn medians_of_even_numbers_are_means() {
        assert_eq!(median([3.0, 1.0, 2.0].into_iter()), 2.0);
        assert_eq!(median([4.0, 1.0, 2.0, 3.0].into_iter()), 2.5);
    }
}
