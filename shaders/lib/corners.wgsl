// Snapped corners by triangle index. Needs the binding `triangles`: nine words a triangle, four of them an element.

// Three elements hold a triangle's nine words, wherever it begins: after up to three others.
fn corners_of(triangle: u32) -> Corners {
    let at = 9u * triangle;
    let a = triangles[at / 4u];
    let b = triangles[at / 4u + 1u];
    let c = triangles[at / 4u + 2u];
    // One word is left out or not, then two.
    let one = (at & 1u) == 1u;
    let d = select(a, vec4<f32>(a.yzw, b.x), one);
    let e = select(b, vec4<f32>(b.yzw, c.x), one);
    let f = select(c.xyz, c.yzw, one);
    let two = (at & 2u) == 2u;
    let g = select(d, vec4<f32>(d.zw, e.xy), two);
    let h = select(e, vec4<f32>(e.zw, f.xy), two);
    return Corners(g.xyz, vec3<f32>(g.w, h.xy), vec3<f32>(h.zw, select(f.x, f.z, two)));
}
