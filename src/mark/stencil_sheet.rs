//! A dimensioned drawing of a stencil: sections, hinge, seam and the table of holes.
//!
//! Sections are cut from the same meshes that are printed, so that what is drawn is what is made;
//! dimensions are the parameters'. Page 1 has the section square to the hinge's axis and the one along
//! the seam, page 2 the seam and the hinge enlarged, the last pages the holes. Every figure states its
//! scale, and each page has the check line.

use serde_json::{Map, json};

use super::drawing::{
    Anchor, Drawing, Item, Layer, Page, PageSize, Point, Shape, TitleBlock, text_width,
};
use crate::geometry::Vec3;
use crate::stencil::{HalfName, HoleSide, Mesh, Stencil};

/// Scales of a figure, the largest that fits is taken.
const SCALES: [f64; 7] = [10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1];
/// Heights of words, mm: titles, all else.
const TITLE_MM: f64 = 3.6;
const WORDS_MM: f64 = 2.4;
/// Size of an arrow's head, mm.
const HEAD_MM: f64 = 1.6;
/// Rows of holes on a page, and their distance, mm.
const ROWS: usize = 40;
const ROW_MM: f64 = 5.6;
/// Part of a shell around the seam that is enlarged, mm beyond what is dimensioned.
const AROUND_MM: f64 = 2.0;

/// A figure on a page: the plane's coordinates at a scale.
struct Figure {
    items: Vec<Item>,
    /// Where the plane's `middle` lies on the page.
    center: Point,
    middle: (f64, f64),
    scale: f64,
}

impl Figure {
    /// A figure of the part of the plane between two corners, within `size` (page mm) about `center`.
    fn new(title: &str, [low, high]: [(f64, f64); 2], size: [f64; 2], center: Point) -> Self {
        let fits = |s: &f64| s * (high.0 - low.0) <= size[0] && s * (high.1 - low.1) <= size[1];
        let smallest = SCALES[SCALES.len() - 1];
        let scale = SCALES.into_iter().find(fits).unwrap_or(smallest);
        let words = if scale >= 1.0 {
            format!("{title}, {scale}:1")
        } else {
            format!("{title}, 1:{}", 1.0 / scale)
        };
        let at = Point::new(center.x, center.y + 0.5 * size[1] + 9.0);
        Self {
            items: vec![Item::words(at, Anchor::Middle, TITLE_MM, words)],
            center,
            middle: (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1)),
            scale,
        }
    }

    fn place(&self, (a, b): (f64, f64)) -> Point {
        Point::new(
            self.center.x + self.scale * (a - self.middle.0),
            self.center.y + self.scale * (b - self.middle.1),
        )
    }

    fn line(&mut self, layer: Layer, points: &[(f64, f64)]) {
        let placed = points.iter().map(|p| self.place(*p)).collect();
        self.items.push(Item::new(layer, Shape::Line(placed)));
    }

    /// Where `mesh` meets the plane: `pick` gives its coordinates and the distance from it. Only what
    /// lies between two corners is drawn.
    fn section(
        &mut self,
        mesh: &Mesh,
        layer: Layer,
        pick: fn(&Vec3) -> [f64; 3],
        bounds: Option<[(f64, f64); 2]>,
    ) {
        for t in 0..mesh.triangles.len() {
            let corners = mesh.corners(t).map(|c| pick(&c));
            let mut ends = Vec::new();
            for i in 0..3 {
                let (p, q) = (corners[i], corners[(i + 1) % 3]);
                if (p[2] > 0.0) != (q[2] > 0.0) {
                    let s = p[2] / (p[2] - q[2]);
                    ends.push((p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])));
                }
            }
            if let &[p, q] = ends.as_slice()
                && let Some((p, q)) = bounds.map_or(Some((p, q)), |b| clipped(p, q, b))
            {
                self.line(layer, &[p, q]);
            }
        }
    }

    /// A dimension from `a` to `b`, drawn `off` page millimeters beside them (to the left of the way
    /// from `a` to `b`).
    fn dimension(&mut self, a: (f64, f64), b: (f64, f64), off: f64, words: String) {
        let (from, to) = (self.place(a), self.place(b));
        let along = (to - from).try_normalize(1e-9).unwrap_or_default();
        let beside = nalgebra::Vector2::new(-along.y, along.x);
        let (p, q) = (from + off * beside, to + off * beside);
        let mut add = |points: Vec<Point>| {
            self.items
                .push(Item::new(Layer::Guides, Shape::Line(points)));
        };
        let over = off.signum() * 1.0;
        add(vec![from + over * beside, p + over * beside]);
        add(vec![to + over * beside, q + over * beside]);
        // Arrows point outwards from within, or where there is no space inwards from without.
        let inner = (q - p).norm() > 4.0 * HEAD_MM;
        let sign = if inner { 1.0 } else { -1.0 };
        let (start, end) = if inner {
            (p, q)
        } else {
            (p - 3.0 * HEAD_MM * along, q + 3.0 * HEAD_MM * along)
        };
        add(vec![start, end]);
        for (tip, way) in [(p, sign * along), (q, -sign * along)] {
            for side in [0.3, -0.3] {
                add(vec![tip, tip + HEAD_MM * (way + side * beside)]);
            }
        }
        let (middle, width) = (p + 0.5 * (q - p), text_width(&words, WORDS_MM));
        let (at, anchor) = if inner && along.x.abs() < 0.5 {
            // On the side that is away from what is measured.
            let away = (off * beside.x).signum();
            let anchor = if away < 0.0 {
                Anchor::End
            } else {
                Anchor::Start
            };
            (middle + nalgebra::Vector2::new(1.2 * away, -1.6), anchor)
        } else if inner && width < (q - p).norm() - 1.0 {
            (middle, Anchor::Middle)
        } else {
            (end + 1.0 * along, Anchor::Start)
        };
        let at = Point::new(at.x, at.y + 0.8);
        self.items.push(Item::words(at, anchor, WORDS_MM, words));
    }
}

/// The part of a line between two corners (Y.-D. Liang, B. A. Barsky, 1984).
fn clipped(
    p: (f64, f64),
    q: (f64, f64),
    [low, high]: [(f64, f64); 2],
) -> Option<((f64, f64), (f64, f64))> {
    let (dx, dy) = (q.0 - p.0, q.1 - p.1);
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for (step, room) in [
        (-dx, p.0 - low.0),
        (dx, high.0 - p.0),
        (-dy, p.1 - low.1),
        (dy, high.1 - p.1),
    ] {
        if step == 0.0 {
            if room < 0.0 {
                return None;
            }
        } else if step < 0.0 {
            from = from.max(room / step);
        } else {
            to = to.min(room / step);
        }
    }
    let at = |t: f64| (p.0 + t * dx, p.1 + t * dy);
    (from < to).then(|| (at(from), at(to)))
}

/// The drawing of `stencil`, on sheets of `page`; their title blocks state `date`, as it is to be
/// written.
pub fn stencil_sheet(stencil: &Stencil, page: PageSize, date: Option<&str>) -> Drawing {
    let config = stencil.config();
    let mut note = Map::new();
    note.insert("kind".into(), json!("stencil drawing"));
    note.insert("pattern_sha256".into(), json!(stencil.pattern_sha256()));
    note.insert("ball_diameter_mm".into(), json!(config.ball_diameter_mm));
    let mut pages = vec![sections(stencil, page), details(stencil, page)];
    pages.extend(hole_pages(stencil, page));
    let id: String = stencil.pattern_sha256().chars().take(12).collect();
    TitleBlock {
        title: "Stencil",
        facts: format!(
            "pattern {id}; ball {} mm; {} holes of {} mm",
            config.ball_diameter_mm,
            stencil.dots().len(),
            config.hole_diameter_mm
        ),
        date,
        legend: None,
    }
    .onto(page, &mut pages);
    Drawing {
        title: format!("Stencil of pattern {id}"),
        note,
        pages,
        line_mm: 0.18,
        is_in_steps: false,
    }
}

/// A page with its heading.
fn headed(stencil: &Stencil, page: PageSize, what: &str, mut items: Vec<Item>) -> Page {
    let [left, _] = page.origin();
    let [width, height] = page.size_mm().unwrap_or([210.0, 297.0]);
    let c = stencil.config();
    let mut say = |down: f64, height_mm: f64, words: String| {
        let at = Point::new(left, height - down);
        items.push(Item::words(at, Anchor::Start, height_mm, words));
    };
    say(14.0, 1.2 * TITLE_MM, format!("Stencil: {what}"));
    let facts = format!(
        "holes: throat {} mm, then {:.0} degrees wider; all lengths in mm, frame of stencil.json",
        c.throat_mm,
        c.taper_rad.to_degrees()
    );
    say(20.0, WORDS_MM, facts);
    page.page(items, [width, height])
}

fn sections(stencil: &Stencil, page: PageSize) -> Page {
    let mut items = section_square_to_hinge(stencil, page);
    items.extend(section_along_seam(stencil, page));
    headed(stencil, page, "sections", items)
}

/// The sides of a page, mm, and what a section may fill of it.
fn section_area(page: PageSize) -> ([f64; 2], [f64; 2]) {
    let [width, height] = page.size_mm().unwrap_or([210.0, 297.0]);
    ([width, height], [width - 60.0, 0.33 * height])
}

fn section_square_to_hinge(stencil: &Stencil, page: PageSize) -> Vec<Item> {
    let (c, j) = (stencil.config(), stencil.joint());
    let ([width, height], area) = section_area(page);
    let (inner, outer) = (c.inner_radius_mm(), c.outer_radius_mm());
    let (tab, hinge) = (outer + c.tab_mm, j.axis_mm + j.knuckle_radius_mm);
    let middle = 0.5 * width + 5.0;
    let mut upright = Figure::new(
        "Section square to the hinge (y = 0)",
        [(-tab, -outer), (hinge, outer)],
        area,
        Point::new(middle, 0.72 * height - 6.0),
    );
    for mesh in &HalfName::BOTH.map(|name| stencil.placed_half(name, 0.0)) {
        upright.section(mesh, Layer::Dots, |v| [v.x, v.z, v.y], None);
    }
    let d = |r: f64| format!("{:.2}", 2.0 * r);
    upright.dimension(
        (-inner, 0.0),
        (inner, 0.0),
        0.0,
        format!("inside {}", d(inner)),
    );
    upright.dimension(
        (outer, -outer),
        (outer, outer),
        -0.5 * (area[0] * 0.06) - 22.0,
        d(outer),
    );
    upright.dimension(
        (0.0, outer),
        (j.axis_mm, outer),
        6.0,
        format!("{:.2}", j.axis_mm),
    );
    upright.dimension(
        (-tab, -outer),
        (hinge, -outer),
        -8.0,
        format!("{:.2}", tab + hinge),
    );
    upright.items
}

fn section_along_seam(stencil: &Stencil, page: PageSize) -> Vec<Item> {
    let (c, j) = (stencil.config(), stencil.joint());
    let ([width, height], area) = section_area(page);
    let (inner, outer) = (c.inner_radius_mm(), c.outer_radius_mm());
    let (tab, hinge) = (outer + c.tab_mm, j.axis_mm + j.knuckle_radius_mm);
    let middle = 0.5 * width + 5.0;
    let mut plan = Figure::new(
        "Section along the seam (z = 0)",
        [(-tab, -outer), (hinge, outer)],
        area,
        Point::new(middle, 0.26 * height),
    );
    for mesh in &HalfName::BOTH.map(|name| stencil.placed_half(name, 0.0)) {
        plan.section(mesh, Layer::Dots, |v| [v.x, v.y, v.z - 0.01], None);
    }
    let half = 0.5 * c.hinge_length_mm;
    plan.dimension(
        (hinge, -half),
        (hinge, half),
        -6.0,
        format!("{}", c.hinge_length_mm),
    );
    let tab_half = 0.5 * j.tab_width_mm;
    plan.dimension(
        (-tab, -tab_half),
        (-tab, tab_half),
        6.0,
        format!("{}", j.tab_width_mm),
    );
    plan.dimension(
        (-tab, -outer),
        (-outer, -outer),
        -6.0,
        format!("{}", c.tab_mm),
    );
    plan.dimension(
        (0.0, inner),
        (0.0, outer),
        12.0,
        format!("wall {}", c.wall_mm),
    );
    plan.items
}

fn details(stencil: &Stencil, page: PageSize) -> Page {
    let mut items = seam(stencil, page);
    items.extend(hinge(stencil, page));
    headed(stencil, page, "seam and hinge", items)
}

fn seam(stencil: &Stencil, page: PageSize) -> Vec<Item> {
    let (c, j) = (stencil.config(), stencil.joint());
    let [a, b] = HalfName::BOTH.map(|name| stencil.placed_half(name, 0.0));
    let [width, height] = page.size_mm().unwrap_or([210.0, 297.0]);
    let (inner, outer) = (c.inner_radius_mm(), c.outer_radius_mm());
    let reach = j.lip_mm + AROUND_MM;
    let narrow = (inner * inner - reach * reach).max(0.0).sqrt();
    // Square to the hinge's axis, away from hinge and tab: the plane x = 0.
    let bounds = [(narrow - 0.6, -reach), (outer + 0.6, reach)];
    let middle = 0.5 * width + 5.0;
    let mut seam = Figure::new(
        "Seam (x = 0)",
        bounds,
        [width - 90.0, 0.3 * height],
        Point::new(middle - 10.0, 0.71 * height),
    );
    seam.section(&a, Layer::Cut, |v| [v.y, v.z, v.x - 0.013], Some(bounds));
    seam.section(&b, Layer::Dots, |v| [v.y, v.z, v.x - 0.013], Some(bounds));
    seam.dimension(
        (outer, -j.lip_mm),
        (outer, j.lip_mm),
        -12.0,
        format!("rims overlap by {:.2}", 2.0 * j.lip_mm),
    );
    let lip = |r: f64| (r * r - j.lip_mm * j.lip_mm).max(0.0).sqrt();
    seam.dimension(
        (j.cone_wide_mm + j.half_gap_mm, -j.lip_mm),
        (lip(outer), -j.lip_mm),
        -9.0,
        format!("lip {:.2}", j.lip_thickness_mm),
    );
    let facts = format!(
        "gap {} between the cones (perpendicular), {} between the ledges; half A red, half B black",
        c.seam_gap_mm, j.ledge_gap_mm
    );
    let at = Point::new(middle - 10.0, 0.55 * height - 6.0);
    seam.items
        .push(Item::words(at, Anchor::Middle, WORDS_MM, facts));
    seam.items
}

fn hinge(stencil: &Stencil, page: PageSize) -> Vec<Item> {
    let (c, j) = (stencil.config(), stencil.joint());
    let [a, b] = HalfName::BOTH.map(|name| stencil.placed_half(name, 0.0));
    let [width, height] = page.size_mm().unwrap_or([210.0, 297.0]);
    let middle = 0.5 * width + 5.0;
    let side = j.knuckle_radius_mm + 3.0;
    let mut hinge = Figure::new(
        "Hinge (y = 0, the middle knuckle)",
        [
            (j.axis_mm - side - 3.0, -side),
            (j.axis_mm + side, side + 2.0),
        ],
        [width - 90.0, 0.28 * height],
        Point::new(middle - 10.0, 0.3 * height),
    );
    let around = Some([
        (j.axis_mm - side - 3.0, -side),
        (j.axis_mm + side, side + 2.0),
    ]);
    let y = |v: &Vec3| [v.x, v.z, v.y];
    hinge.section(&a, Layer::Cut, y, around);
    hinge.section(&b, Layer::Dots, y, around);
    let (axis, r) = (j.axis_mm, j.knuckle_radius_mm);
    hinge.dimension(
        (axis - j.bore_radius_mm, 0.0),
        (axis + j.bore_radius_mm, 0.0),
        -0.01,
        format!("{:.2}", 2.0 * j.bore_radius_mm),
    );
    // From the middle: on the bed's side the knuckle is flat.
    hinge.dimension(
        (axis, 0.0),
        (axis + r, 0.0),
        -hinge.scale * r - 5.0,
        format!("radius {r:.2}"),
    );
    let facts = format!(
        "{} knuckles {:.2} long, {} apart; bore {:.2} for a {}",
        c.knuckles,
        j.knuckle_mm,
        c.knuckle_clearance_mm,
        2.0 * j.bore_radius_mm,
        match c.closure {
            crate::stencil::Closure::Screw => format!("screw M{}", c.screw_diameter_mm),
            crate::stencil::Closure::Pin => format!("printed pin of {}", c.screw_diameter_mm),
        }
    );
    let at = Point::new(middle - 10.0, 0.13 * height);
    hinge
        .items
        .push(Item::words(at, Anchor::Middle, WORDS_MM, facts));
    hinge.items
}

fn hole_pages(stencil: &Stencil, page: PageSize) -> Vec<Page> {
    let [left, _] = page.origin();
    let [_, height] = page.size_mm().unwrap_or([210.0, 297.0]);
    let columns = [0.0, 18.0, 46.0, 72.0, 98.0, 118.0, 138.0].map(|x| left + 14.0 + x);
    let heads = [
        "dot",
        "half",
        "latitude [deg]",
        "azimuth [deg]",
        "x",
        "y",
        "z",
    ];
    let dots: Vec<_> = stencil
        .dots()
        .iter()
        .zip(stencil.sides())
        .enumerate()
        .collect();
    dots.chunks(ROWS)
        .map(|rows| {
            let mut items = Vec::new();
            let mut row = |y: f64, cells: [String; 7]| {
                for (x, words) in columns.iter().zip(cells) {
                    items.push(Item::words(Point::new(*x, y), Anchor::End, WORDS_MM, words));
                }
            };
            let top = height - 32.0;
            row(top, heads.map(str::to_owned));
            for (k, (i, (d, side))) in rows.iter().enumerate() {
                let half = match side {
                    HoleSide::A => "A",
                    HoleSide::B => "B",
                    HoleSide::Both => "A + B",
                };
                let degrees = |angle: f64| format!("{:.2}", angle.to_degrees());
                let cells = [
                    i.to_string(),
                    half.to_owned(),
                    degrees(d.z.clamp(-1.0, 1.0).asin()),
                    degrees(d.y.atan2(d.x)),
                    format!("{:.5}", d.x),
                    format!("{:.5}", d.y),
                    format!("{:.5}", d.z),
                ];
                row(top - ROW_MM * (k + 1) as f64, cells);
            }
            headed(stencil, page, "holes", items)
        })
        .collect()
}
