//! Triangles of COLLADA files (`.dae`): all geometry that the visual scene shows, placed by its nodes, in
//! metres by the file's unit. The file's up axis turns nothing: robots' descriptions count on that.
//!
//! Source: "COLLADA - Digital Asset Schema Release 1.4.1", Khronos Group 2008.

use crate::scene::packing::FileProblem;
use graintrain::math::{Mat3, Mat4, Quat, Vec3};
use roxmltree::{Document, Node};
use std::collections::HashMap;

/// Nodes inside of nodes at most: one that holds itself has no end.
const DEEPEST: usize = 64;

/// Nodes and triangles shown at most, instances counted each time: a few that hold each other can be any
/// number.
const MOST: [usize; 2] = [100_000, 10_000_000];

/// Corners of all triangles.
pub(super) fn read(text: &str) -> Result<Vec<[Vec3; 3]>, FileProblem> {
    let document = Document::parse(text).map_err(|error| {
        FileProblem::at(error.pos().row as usize, format!("it is not valid XML: {error}"))
    })?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        let found = root.tag_name().name();
        return Err(FileProblem::at(1, format!("it is no COLLADA file: <COLLADA> expected, not <{found}>")));
    }
    let unit = root.descendants().find(|node| is(*node, "unit")).and_then(|unit| unit.attribute("meter"));
    let unit = unit.and_then(|meter| meter.parse::<f64>().ok()).filter(|&meter| meter > 0.0).unwrap_or(1.0);
    let mut reader = Reader { by_id: HashMap::new(), triangles: Vec::new(), nodes: 0 };
    let named = root.descendants().filter_map(|node| Some((node.attribute("id")?, node)));
    reader.by_id.extend(named);
    let scaled = Mat4::from_scale(Vec3::splat(unit));
    let scenes: Vec<Node> = root.descendants().filter(|node| is(*node, "visual_scene")).collect();
    for scene in &scenes {
        reader.children(*scene, scaled, 0)?;
    }
    if scenes.is_empty() {
        for geometry in root.descendants().filter(|node| is(*node, "geometry")) {
            reader.geometry(geometry, scaled)?;
        }
    }
    Ok(reader.triangles)
}

fn is(node: Node, name: &str) -> bool {
    node.is_element() && node.tag_name().name() == name
}

fn of_name<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |child| is(*child, name))
}

fn problem(node: Node, what: impl Into<String>) -> FileProblem {
    FileProblem::at(node.document().text_pos_at(node.range().start).row as usize, what)
}

/// The numbers of an element.
fn numbers<T: std::str::FromStr>(node: Node) -> Result<Vec<T>, FileProblem> {
    let words = node.text().unwrap_or_default().split_ascii_whitespace();
    let parse = |word: &str| word.parse().map_err(|_| problem(node, format!("`{word:.40}` is not a number")));
    words.map(parse).collect()
}

fn exactly<const N: usize>(node: Node) -> Result<[f64; N], FileProblem> {
    numbers(node)?.try_into().map_err(|found: Vec<f64>| {
        problem(node, format!("<{}> needs {N} numbers, not {}", node.tag_name().name(), found.len()))
    })
}

struct Reader<'a> {
    by_id: HashMap<&'a str, Node<'a, 'a>>,
    triangles: Vec<[Vec3; 3]>,
    /// Looked into so far.
    nodes: usize,
}

impl<'a> Reader<'a> {
    /// The element that an attribute such as `url="#box"` names.
    fn named(&self, node: Node<'a, 'a>, attribute: &str) -> Result<Node<'a, 'a>, FileProblem> {
        let name = node.attribute(attribute).unwrap_or_default().trim_start_matches('#');
        let found = self.by_id.get(name).copied();
        found.ok_or_else(|| problem(node, format!("`{attribute}` names `{name:.40}`, which is not there")))
    }

    /// What the nodes in a node or scene show.
    fn children(&mut self, parent: Node<'a, 'a>, frame: Mat4, depth: usize) -> Result<(), FileProblem> {
        self.nodes += 1;
        if depth > DEEPEST || self.nodes > MOST[0] || self.triangles.len() > MOST[1] {
            return Err(problem(parent, "its nodes are nested too deeply, or show too much"));
        }
        for node in parent.children() {
            match node.tag_name().name() {
                "node" => {
                    let mut own = frame;
                    for step in node.children().filter(Node::is_element) {
                        own *= transform(step)?;
                    }
                    self.children(node, own, depth + 1)?;
                }
                "instance_node" => {
                    let other = self.named(node, "url")?;
                    let mut own = frame;
                    for step in other.children().filter(Node::is_element) {
                        own *= transform(step)?;
                    }
                    self.children(other, own, depth + 1)?;
                }
                "instance_geometry" => self.geometry(self.named(node, "url")?, frame)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn geometry(&mut self, geometry: Node<'a, 'a>, frame: Mat4) -> Result<(), FileProblem> {
        for mesh in of_name(geometry, "mesh") {
            for primitive in mesh.children() {
                let name = primitive.tag_name().name();
                if matches!(name, "triangles" | "polylist" | "polygons") {
                    self.primitive(primitive, frame)?;
                } else if matches!(name, "trifans" | "tristrips") {
                    return Err(problem(primitive, format!("<{name}> is not read: export triangles")));
                }
            }
        }
        Ok(())
    }

    fn primitive(&mut self, primitive: Node<'a, 'a>, frame: Mat4) -> Result<(), FileProblem> {
        let offset = |input: Node| match input.attribute("offset").map(str::parse::<u16>) {
            None => Ok(0),
            Some(Ok(offset)) => Ok(usize::from(offset)),
            Some(Err(error)) => Err(problem(input, format!("its `offset` cannot be: {error}"))),
        };
        let inputs = || of_name(primitive, "input");
        let Some(vertex) = inputs().find(|input| input.attribute("semantic") == Some("VERTEX")) else {
            return Err(problem(primitive, "it has no input of vertices"));
        };
        let own = offset(vertex)?;
        let stride = 1 + inputs().map(offset).try_fold(own, |most, next| Ok(most.max(next?)))?;
        let points = self.points(self.named(vertex, "source")?)?;
        let counts = of_name(primitive, "vcount").next().map(numbers::<usize>).transpose()?;
        for list in of_name(primitive, "p") {
            let numbers = numbers::<usize>(list)?;
            let corners = numbers.chunks_exact(stride).map(|of_corner| {
                let place = of_corner[own];
                let point = points.get(place).copied();
                point.ok_or_else(|| {
                    problem(list, format!("there is no vertex {place}: there are {}", points.len()))
                })
            });
            let corners = corners.map(|point| Ok(frame.transform_point3(point?)));
            let corners: Vec<Vec3> = corners.collect::<Result<_, FileProblem>>()?;
            if let Some(far) = corners.iter().find(|corner| !corner.is_finite()) {
                return Err(problem(list, format!("a coordinate is not finite: {far}")));
            }
            let mut rest = corners.as_slice();
            let sizes: Vec<usize> = match (&counts, primitive.tag_name().name()) {
                (Some(counts), _) => counts.clone(),
                (None, "polygons") => vec![corners.len()],
                _ => vec![3; corners.len() / 3],
            };
            for size in sizes {
                let Some((polygon, others)) = rest.split_at_checked(size) else {
                    return Err(problem(list, "it is cut short: polygons need more corners"));
                };
                rest = others;
                let fan = polygon.get(1..).unwrap_or_default().windows(2);
                self.triangles.extend(fan.map(|pair| [polygon[0], pair[0], pair[1]]));
            }
        }
        Ok(())
    }

    /// The points of a <vertices>.
    fn points(&self, vertices: Node<'a, 'a>) -> Result<Vec<Vec3>, FileProblem> {
        let is_position = |input: &Node| input.attribute("semantic") == Some("POSITION");
        let input = of_name(vertices, "input").find(is_position);
        let input = input.ok_or_else(|| problem(vertices, "its vertices have no positions"))?;
        let source = self.named(input, "source")?;
        let array = of_name(source, "float_array").next();
        let array = array.ok_or_else(|| problem(source, "its positions are no <float_array>"))?;
        let accessor = source.descendants().find(|node| is(*node, "accessor"));
        let of = |name| accessor.and_then(|node| node.attribute(name)).and_then(|n| n.parse::<usize>().ok());
        let (stride, offset) = (of("stride").unwrap_or(3).max(3), of("offset").unwrap_or(0));
        let numbers = numbers::<f64>(array)?;
        let points = numbers.get(offset..).unwrap_or_default().chunks_exact(stride);
        Ok(points.map(|point| Vec3::new(point[0], point[1], point[2])).collect())
    }
}

/// What an element of a node does to its frame; nothing, where it is no transformation.
fn transform(node: Node) -> Result<Mat4, FileProblem> {
    Ok(match node.tag_name().name() {
        "matrix" => Mat4::from_cols_array(&exactly(node)?).transpose(),
        "translate" => Mat4::from_translation(Vec3::from_array(exactly(node)?)),
        "scale" => Mat4::from_scale(Vec3::from_array(exactly(node)?)),
        "rotate" => {
            let [x, y, z, degrees] = exactly(node)?;
            let axis = Vec3::new(x, y, z).normalize_or_zero();
            let turn = if axis == Vec3::ZERO {
                Quat::IDENTITY
            } else {
                Quat::from_axis_angle(axis, f64::to_radians(degrees))
            };
            Mat4::from_mat3(Mat3::from_quat(turn))
        }
        _ => Mat4::IDENTITY,
    })
}
