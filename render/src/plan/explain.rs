//! A plan as text.

use super::Plan;
use crate::kernel::{Buffer, Kernel};
use crate::settings::LightTransport;
use core::fmt::Write;

impl Plan {
    /// The plan as text: what runs, what is left out and why, and the bytes of every buffer.
    pub fn explain(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let mut line = |arguments: core::fmt::Arguments<'_>| {
            let _ = writeln!(text, "{arguments}");
        };
        let (width, height) = (self.size.width(), self.size.height());
        let samples = self.settings.samples;
        line(format_args!(
            "frame    {width}x{height}, {samples} camera rays a pixel, in {} slices of at most {} pixels",
            self.slices(),
            self.slice_pixels
        ));
        line(format_args!(
            "waves    at most {} a slice, of at most {} paths",
            self.waves(),
            self.path_room
        ));
        if self.photons() > 0 {
            line(format_args!(
                "photons  {} a pass, at least one of each light, of at most {} rays each",
                self.photons(),
                self.settings.depth + 1
            ));
        }
        let steps: Vec<&str> = self.kernels().map(Kernel::name).collect();
        line(format_args!("steps    {}", steps.join(", ")));
        for reason in self.left_out() {
            line(format_args!("without  {reason}"));
        }
        let mut total = 0;
        for buffer in Buffer::ALLOCATED {
            let (elements, bytes) = (self.elements(buffer), self.bytes(buffer));
            total += bytes;
            if elements > 0 {
                line(format_args!(
                    "buffer   {:<12} {elements:>9} x {:>2} B = {bytes:>11} B",
                    format!("{buffer:?}"),
                    buffer.element_size()
                ));
            }
        }
        line(format_args!(
            "buffers  {total} B in all, besides the tree and what an executor needs for itself"
        ));
        text
    }

    /// What does not run, and why.
    fn left_out(&self) -> Vec<&'static str> {
        let needs = &self.needs;
        let mut reasons = Vec::new();
        if !self.outputs.shades() {
            reasons.push("light: no picture is wanted");
            return reasons;
        }
        match (needs.mirrors || needs.dielectrics, self.settings.depth) {
            (false, 1..) if !self.is_direct() => {}
            (false, _) if self.is_direct() => {
                reasons.push("further waves: nothing mirrors or refracts");
            }
            (_, 0) => reasons.push("further waves: the depth is 0"),
            _ if !needs.dielectrics => reasons.push("refraction: nothing is clear"),
            _ => {}
        }
        if self.settings.light == LightTransport::Photons && self.photons() == 0 {
            reasons.push(match (needs.diffuse, self.settings.depth) {
                (true, 1..) => "photons: nothing shines",
                (true, 0) => "photons: the depth is 0",
                (false, _) => "photons: no surface scatters light evenly",
            });
        }
        if self.light_samples() == 0 {
            reasons.push("shadow rays: there are no lights");
        } else if !self.casts_shadows() {
            reasons.push("shadow rays: no surface scatters light");
        }
        if needs.emitters == 0 {
            reasons.push("area lights: nothing shines");
        } else if self.settings.area_samples == 0 {
            reasons.push("area lights: no samples are asked for");
        }
        if !needs.smooth_normals {
            reasons.push("smooth normals: the scene has none");
        }
        if !needs.textures {
            reasons.push("textures: the scene has none");
        }
        reasons
    }
}
