//! Packets of rays, formed before they are asked: of as many as Embree's instruction set has lanes.

use splitplane_core::ray::Ray;

use super::{Arguments, Embree, FEATURES, Handle, NONE, flushing};

/// `RTC_RAY_QUERY_FLAG_COHERENT`: neighbours go the same way.
const COHERENT: u32 = 1 << 16;

/// `rtcIntersect16`, and `rtcOccluded16`, which reads and writes the rays alone; or those of 8.
pub(crate) type Query<const N: usize> =
    unsafe extern "C" fn(*const [i32; N], Handle, *mut Packet<N>, *mut Arguments);

/// `RTCRayHit16`, or `RTCRayHit8`.
#[repr(C, align(64))]
pub(crate) struct Packet<const N: usize> {
    origin: [[f32; N]; 3],
    t_near: [f32; N],
    direction: [[f32; N]; 3],
    time: [f32; N],
    t_far: [f32; N],
    mask: [u32; N],
    id: [u32; N],
    flags: [u32; N],
    normal: [[f32; N]; 3],
    uv: [[f32; N]; 2],
    triangle: [u32; N],
    geometry: [u32; N],
    /// Instance fields, of which later versions have two.
    instance: [[u32; N]; 4],
}

impl<const N: usize> Packet<N> {
    /// Of at most `N` rays; which places have one.
    fn new(rays: &[Ray]) -> (Packet<N>, [i32; N]) {
        let (of, zero) = (|lane: usize| &rays[lane.min(rays.len() - 1)], [0.0; N]);
        let packet = Packet {
            origin: [0, 1, 2].map(|axis| std::array::from_fn(|lane| of(lane).origin[axis])),
            t_near: std::array::from_fn(|lane| of(lane).t_min),
            direction: [0, 1, 2].map(|axis| std::array::from_fn(|lane| of(lane).direction[axis])),
            time: zero,
            t_far: std::array::from_fn(|lane| of(lane).t_max),
            mask: [u32::MAX; N],
            id: [0; N],
            flags: [0; N],
            normal: [zero; 3],
            uv: [zero; 2],
            triangle: [NONE; N],
            geometry: [NONE; N],
            instance: [[NONE; N]; 4],
        };
        (packet, std::array::from_fn(|lane| -i32::from(lane < rays.len())))
    }
}

/// The rays of a set as packets. They are used up by a query, whose answers stand in them.
pub(crate) struct Packets<const N: usize>(Vec<(Packet<N>, [i32; N])>);

impl<const N: usize> Packets<N> {
    pub(crate) fn new(rays: &[Ray]) -> Packets<N> {
        Packets(rays.chunks(N).map(Packet::new).collect())
    }

    /// Distance (infinity for none) and triangle of each ray's closest hit.
    pub(crate) fn closest(&mut self, embree: &Embree, hits: &mut [(f32, u32)])
    where
        Embree: Of<N>,
    {
        self.ask(embree, embree.queries().0);
        for ((packet, _), hits) in self.0.iter().zip(hits.chunks_mut(N)) {
            for (lane, hit) in hits.iter_mut().enumerate() {
                let missed = packet.geometry[lane] == NONE;
                let found = (packet.t_far[lane], packet.triangle[lane]);
                *hit = if missed { (f32::INFINITY, NONE) } else { found };
            }
        }
    }

    /// Whether each ray hits anything.
    pub(crate) fn any(&mut self, embree: &Embree, hits: &mut [bool])
    where
        Embree: Of<N>,
    {
        self.ask(embree, embree.queries().1);
        for ((packet, _), hits) in self.0.iter().zip(hits.chunks_mut(N)) {
            for (lane, hit) in hits.iter_mut().enumerate() {
                // Minus infinity says that there is something.
                *hit = packet.t_far[lane] < 0.0;
            }
        }
    }

    fn ask(&mut self, embree: &Embree, query: Query<N>) {
        let mut arguments = Arguments { flags: COHERENT, features: FEATURES, pointers: [0; 6] };
        flushing(|| {
            for (packet, there) in &mut self.0 {
                // SAFETY: a committed scene, and structures as Embree reads and writes them.
                unsafe { query(there, embree.scene, packet, &mut arguments) };
            }
        });
    }
}

/// The queries of packets of `N` rays: closest and any hits.
pub(crate) trait Of<const N: usize> {
    /// Both.
    fn queries(&self) -> (Query<N>, Query<N>);
}

impl Of<16> for Embree {
    fn queries(&self) -> (Query<16>, Query<16>) {
        self.calls.by_16
    }
}

impl Of<8> for Embree {
    fn queries(&self) -> (Query<8>, Query<8>) {
        self.calls.by_8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_without_a_ray_are_marked_and_hold_a_ray_that_is_there() {
        let ray = |x: f32| Ray::new([x, 0.0, 0.0], [0.0, 0.0, 1.0]).with_limits(x, 9.0);
        let (packet, there) = Packet::<8>::new(&[ray(1.0), ray(2.0), ray(3.0)]);
        assert_eq!(there, [-1, -1, -1, 0, 0, 0, 0, 0]);
        assert_eq!(packet.origin[0], [1.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0]);
        assert_eq!(packet.t_near[..3], [1.0, 2.0, 3.0]);
        // Twelve rows of the ray, and seven of the hit before those of instances.
        assert_eq!(std::mem::offset_of!(Packet<16>, normal), 12 * 64);
        assert_eq!(std::mem::offset_of!(Packet<16>, instance), 19 * 64);
        assert_eq!(Packets::<8>::new(&[ray(1.0); 17]).0.len(), 3);
    }
}
