#[test]
fn parse() {
    for s in splitplane_shaders::RENDER {
        let src = s.source();
        match naga::front::wgsl::parse_str(&src) {
            Err(e) => println!("{}: {}", s.name, e.emit_to_string(&src)),
            Ok(m) => {
                let r = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty()).validate(&m);
                if let Err(e) = r { println!("{}: {}", s.name, e.emit_to_string(&src)); }
            }
        }
    }
}
