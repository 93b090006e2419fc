//! The page: one HTML file with its style, its scripts, its shaders and the scene's description.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use liveview::{Camera, Intrinsics};
use liveview_synthesizer::Scene;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

const HTML: &str = include_str!("page/index.html");
const STYLE: &str = include_str!("page/view.css");
const SCRIPT: &str = concat!(
    "(() => {\n\"use strict\";\n",
    include_str!("page/maths.js"),
    include_str!("page/choose.js"),
    include_str!("page/photo.js"),
    include_str!("page/draw.js"),
    include_str!("page/source.js"),
    include_str!("page/input.js"),
    include_str!("page/rig.js"),
    include_str!("page/timeline.js"),
    include_str!("page/view.js"),
    "})();\n"
);
const SHADERS: [(&str, &str); 10] = [
    ("common.glsl", include_str!("page/common.glsl")),
    ("points.vert", include_str!("page/points.vert")),
    ("points.frag", include_str!("page/points.frag")),
    ("screen.vert", include_str!("page/screen.vert")),
    ("fuse.frag", include_str!("page/fuse.frag")),
    ("shrink.frag", include_str!("page/shrink.frag")),
    ("fill.frag", include_str!("page/fill.frag")),
    ("blend.frag", include_str!("page/blend.frag")),
    ("show.frag", include_str!("page/show.frag")),
    ("sharpen.frag", include_str!("page/sharpen.frag")),
];

/// The page of a scene. It runs its own script alone, and loads nothing but, if it is served, what the same server has.
pub(crate) fn page(description: &Value, is_served: bool) -> String {
    let hash = |text: &str| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(text)));
    let own = if is_served { "'self'" } else { "" };
    let policy = format!(
        "default-src 'none'; script-src {}; style-src {}; img-src blob: data: {own}; connect-src {own}; base-uri 'none'; form-action 'none'",
        hash(SCRIPT),
        hash(STYLE),
    );
    let shader = |(name, text): (&str, &str)| format!("<script type=\"text/plain\" id=\"{name}\">{text}</script>\n");
    // Within a script element only `<` could end it; within JSON it stands in strings alone.
    let description = description.to_string().replace('<', "\\u003c");
    let parts = [
        ("{policy}", policy.as_str()),
        ("{style}", STYLE),
        ("{shaders}", &SHADERS.map(shader).concat()),
        ("{scene}", &description),
        ("{script}", SCRIPT),
    ];
    let mut page = String::with_capacity(HTML.len() + SCRIPT.len() + description.len() + (64 << 10));
    let mut rest = HTML;
    for (mark, part) in parts {
        let (before, after) = rest.split_once(mark).expect("a mark of the page");
        page.extend([before, part]);
        rest = after;
    }
    page + rest
}

/// What the page knows of a scene: its views, `free` of which are drawn from, and where to begin. `start`: index of a
/// view.
pub(crate) fn description(scene: &Scene, held_out: &[usize], start: usize, (near, far): (f64, f64)) -> Value {
    let view = |(index, view): (usize, &liveview_scene::View)| {
        let (held_out, skew) = (held_out.contains(&index), view.camera.intrinsics().skew);
        json!({ "name": view.name, "camera": camera_json(&view.camera), "skew": skew, "held_out": held_out })
    };
    let folder = scene.root.canonicalize().unwrap_or_else(|_| scene.root.clone());
    json!({
        "scene": folder.file_name().unwrap_or_default().to_string_lossy(),
        "views": scene.views.iter().enumerate().map(view).collect::<Vec<_>>(),
        // JSON has no infinity.
        "start": start, "near": near, "far": far.is_finite().then_some(far),
    })
}

/// A camera in the format that `render --pose` reads, which has no skew.
fn camera_json(camera: &Camera) -> Value {
    let (rotation, translation) = (camera.rotation(), camera.translation());
    let row = |row: usize| [rotation.row(row).x, rotation.row(row).y, rotation.row(row).z, translation[row]];
    let Intrinsics { fx, fy, cx, cy, .. } = camera.intrinsics();
    json!({
        "cam_from_world": [row(0), row(1), row(2)],
        "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": camera.width(), "h": camera.height(),
    })
}
