//! How much is measured, so that a sweep ends in time.

use super::plan::{Device, Station};
use super::rounds::WARM_MS;
use super::row::KINDS;
use splitplane_core::config::Preset;
use splitplane_core::ray::Accuracy;

/// What a user may fix; the rest follows from the time there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fixed {
    /// Repeats.
    pub repeat: Option<usize>,
    /// Rays on the CPU.
    pub cpu: FixedRays,
    /// Rays on a GPU.
    pub gpu: FixedRays,
}

/// Numbers of rays that a user may fix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FixedRays {
    /// Rays of a timed set.
    pub sample: Option<usize>,
    /// Rays of each kind that are judged.
    pub error: Option<u64>,
}

/// How much is measured on a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Amount {
    /// Most rays of a timed set.
    pub sample_rays: usize,
    /// Rays of each kind that are judged.
    pub error_rays: u64,
}

/// What preset `fast` takes on a device, roughly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pilot {
    /// Milliseconds to build.
    pub build_ms: f64,
    /// Nanoseconds a ray, by accuracy in the order of [`Accuracy::ALL`].
    pub ns_per_ray: [f64; 3],
}

impl Pilot {
    /// Nanoseconds a ray, over all accuracies of a station.
    fn ns_of(&self, station: &Station) -> f64 {
        let of = |accuracy: &Accuracy| Accuracy::ALL.iter().position(|own| own == accuracy);
        let places = station.accuracies.iter().filter_map(of);
        places.map(|place| self.ns_per_ray[place].max(1e-3)).sum()
    }
}

/// Most and least rays of a timed set. Below the least, a batch is over before all threads are at
/// work; beyond the most, times no longer change.
pub const SAMPLE_RAYS: [usize; 2] = [1 << 10, 1 << 17];
/// The same for rays of each kind that are judged.
pub const ERROR_RAYS: [u64; 2] = [1_000, 250_000];
/// Repeats that count where builds leave time for rays: the more, the better a median is known.
const REPEATS: [usize; 3] = [21, 15, 9];
/// Repeats that count, where builds take no more than half of the time.
pub const REPEAT: usize = 5;
/// Part of the time that builds may take before repeats are given up.
const BUILDS: f64 = 0.5;
/// Part of the rest that timed rays may take; judged ones may take what is left.
const SAMPLES: f64 = 0.55;

/// How much is measured on each device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Rounds that count; one more warms up.
    pub repeat: usize,
    /// On the CPU.
    pub cpu: Amount,
    /// On a GPU.
    pub gpu: Amount,
}

impl Budget {
    /// What there is for a device.
    pub fn of(&self, device: Device) -> Amount {
        match device {
            Device::Cpu => self.cpu,
            Device::Gpu => self.gpu,
        }
    }
}

/// How much longer a station's builds take than those of preset `fast` on all threads, and its rays for
/// want of threads: rough, and on the safe side of what was measured.
fn weights(station: &Station, most_threads: usize) -> [f64; 2] {
    let build = match station.config.preset() {
        Preset::Fast => 1.2,
        Preset::Narrow | Preset::Balanced => 2.2,
        _ => 3.5,
    };
    let threads = match station.device {
        Device::Cpu => most_threads as f64 / station.threads.max(1) as f64,
        Device::Gpu => 1.0,
    };
    [build * threads, threads]
}

/// Divides the time among builds, timed rays and judged rays. The devices get equal parts.
///
/// Repeats go down to 3 and then to 1 when builds alone would take half of the time; numbers of
/// rays stay within [`SAMPLE_RAYS`] and [`ERROR_RAYS`]. So a scene of which a single build takes
/// long is measured once with few rays, and the time is exceeded.
pub fn divide(
    seconds: f64,
    stations: &[Station],
    pilot: impl Fn(Device) -> Pilot,
    fixed: &Fixed,
) -> Budget {
    let most = stations.iter().map(|station| station.threads).max().unwrap_or(1);
    let devices: Vec<Device> = [Device::Cpu, Device::Gpu]
        .into_iter()
        .filter(|device| stations.iter().any(|station| station.device == *device))
        .collect();
    let part = 1e3 * seconds / devices.len().max(1) as f64;
    // Weights of builds, and milliseconds of a ray of each kind through all stations; the same of those
    // that are judged.
    let sums = |device: Device| {
        let own = || stations.iter().filter(move |station| station.device == device);
        let add = |sum: [f64; 2], station: &Station| {
            let [build, threads] = weights(station, most);
            [sum[0] + build, sum[1] + threads * 1e-6 * pilot(device).ns_of(station)]
        };
        let all = own().fold([0.0; 2], add);
        // Answers do not depend on threads, so they are judged once.
        let judged = own().filter(|station| station.threads == most || device == Device::Gpu);
        (all, judged.fold([0.0; 2], add)[1])
    };
    let builds = |device: Device| {
        let build_ms = pilot(device).build_ms;
        sums(device).0[0] * build_ms * if build_ms < WARM_MS { 2.0 } else { 1.0 }
    };
    let fits = |repeat: usize| {
        devices.iter().all(|&device| (repeat + 1) as f64 * builds(device) <= BUILDS * part)
    };
    // More rounds only where they leave sets their most rays.
    let fits_with_rays = |repeat: usize| {
        devices.iter().all(|&device| {
            let rays = 4.0 * SAMPLE_RAYS[1] as f64 * sums(device).0[1];
            let rounds = (repeat + 1) as f64;
            rounds * builds(device) <= BUILDS * part
                && rounds * rays <= SAMPLES * (part - rounds * builds(device))
        })
    };
    let more = REPEATS.into_iter().find(|&repeat| fits_with_rays(repeat));
    let few = || [REPEAT, 3].into_iter().find(|&repeat| fits(repeat)).unwrap_or(1);
    let repeat = fixed.repeat.unwrap_or_else(|| more.unwrap_or_else(few));
    let amount = |device: Device| {
        if !devices.contains(&device) {
            return Amount { sample_rays: 0, error_rays: 0 };
        }
        let rounds = (repeat + 1) as f64;
        let left = (part - rounds * builds(device)).max(0.0);
        let ([_, rays], judged) = sums(device);
        let samples = SAMPLES * left / (rounds * 4.0 * rays).max(1e-9);
        // Judging a ray takes about as long as tracing two.
        let errors = (1.0 - SAMPLES) * left / (3.0 * KINDS as f64 * judged).max(1e-9);
        let fixed = if device == Device::Cpu { fixed.cpu } else { fixed.gpu };
        let [least, most] = SAMPLE_RAYS.map(|x| x as f64);
        let samples = samples.clamp(least, most) as usize;
        let [least, most] = ERROR_RAYS.map(|x| x as f64);
        let errors = errors.clamp(least, most) as u64;
        Amount {
            sample_rays: fixed.sample.unwrap_or(samples),
            error_rays: fixed.error.unwrap_or(errors),
        }
    };
    Budget { repeat, cpu: amount(Device::Cpu), gpu: amount(Device::Gpu) }
}

#[cfg(test)]
mod tests {
    use super::super::plan::{Scope, stations};
    use super::*;

    fn all() -> Vec<Station> {
        stations(&Scope {
            presets: Preset::ALL.to_vec(),
            knobs: true,
            accuracies: Accuracy::ALL.to_vec(),
            devices: vec![Device::Cpu],
            threads: vec![1, 2],
        })
    }

    fn divided(build_ms: f64, ns: f64, fixed: Fixed) -> Budget {
        divide(100.0, &all(), |_| Pilot { build_ms, ns_per_ray: [ns; 3] }, &fixed)
    }

    #[test]
    fn a_small_scene_gets_all_and_a_large_one_less() {
        let small = divided(1.0, 50.0, Fixed::default());
        assert_eq!(small.repeat, REPEATS[0]);
        assert_eq!(small.cpu, Amount { sample_rays: SAMPLE_RAYS[1], error_rays: ERROR_RAYS[1] });
        assert_eq!(small.gpu.sample_rays, 0, "there is none");
        let slower = divided(30.0, 2_000.0, Fixed::default());
        assert!(slower.cpu.sample_rays < SAMPLE_RAYS[1] && slower.cpu.error_rays < ERROR_RAYS[1]);
        assert!(slower.cpu.sample_rays > SAMPLE_RAYS[0]);
        assert_eq!(slower.repeat, REPEAT);
        let between = divided(6.0, 80.0, Fixed::default());
        assert_eq!((between.repeat, between.cpu.sample_rays), (15, SAMPLE_RAYS[1]));
        let huge = divided(60_000.0, 50.0, Fixed::default());
        assert_eq!((huge.repeat, huge.cpu.sample_rays), (1, SAMPLE_RAYS[0]));
    }

    #[test]
    fn what_is_fixed_stays() {
        let rays = FixedRays { sample: Some(77), error: Some(5) };
        let fixed = Fixed { repeat: Some(9), cpu: rays, gpu: FixedRays::default() };
        let budget = divided(60_000.0, 50.0, fixed);
        assert_eq!(budget.repeat, 9);
        assert_eq!(budget.cpu, Amount { sample_rays: 77, error_rays: 5 });
    }

    /// What is estimated to be done is estimated to end in time, wherever no bound binds.
    #[test]
    fn the_parts_fit_the_whole() {
        for (build_ms, ns) in [(50.0, 500.0), (150.0, 900.0), (200.0, 5_000.0)] {
            let budget = divided(build_ms, ns, Fixed::default());
            let rounds = (budget.repeat + 1) as f64;
            let mut ms = 0.0;
            for station in all() {
                let [build, threads] = weights(&station, 2);
                ms += 2.0 * rounds * build * build_ms;
                let ray = threads * ns * 1e-6 * station.accuracies.len() as f64;
                ms += rounds * ray * 4.0 * budget.cpu.sample_rays as f64;
                if station.threads == 2 {
                    ms += 3.0 * KINDS as f64 * ray * budget.cpu.error_rays as f64;
                }
            }
            assert!(ms <= 100_000.0, "{build_ms} {ns}: {ms}");
        }
    }
}
