//! Measurements of a run: what is measured when, in which columns, and what has to be remembered from record
//! to record.

use crate::body_numbers::{BodyNumbers, Members};
use crate::column::{Column, column};
use crate::open_boundaries::OpenBoundaryState;
use graintrain::handle::BodyId;
use graintrain::load::Region;
use graintrain::math::{Mat3, Vec3};
use graintrain::measure::contacts::{
    anisotropy, coordination, fabric, force_histogram, force_statistics, normal_forces,
};
use graintrain::measure::energy::{Ledger, energies};
use graintrain::measure::flow::{Passed, Plane, force_on};
use graintrain::measure::mixing::{among, centre_of_mass, lacey};
use graintrain::measure::profile::{Along, Bins, profile};
use graintrain::measure::repose::slope;
use graintrain::measure::space::{own_space, porosity, selected, volume};
use graintrain::measure::stress::{deviator, pressure, stress};
use graintrain::measure::wheel::{Rolling, wheel};
use graintrain::world::World;
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};

/// A measurement: some quantities of some bodies, from some step on, every so many steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// Its name, which is that of its table.
    pub name: String,
    /// The bodies that are meant; `None`: all.
    pub bodies: Option<Members>,
    /// Only bodies whose centre of mass is here.
    pub region: Option<Region>,
    /// Number of the only stage that has records; `None`: all.
    pub stage: Option<usize>,
    /// The first step that may have a record.
    pub start: u64,
    /// Steps from record to record, at least 1.
    pub every: u64,
    /// What is measured, in the order of the columns.
    pub quantities: Vec<Quantity>,
}

/// What can be measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Quantity {
    /// The stress tensor.
    Stress,
    /// Coordination; rattlers have fewer neighbours than this.
    Coordination(usize),
    /// The fabric tensor.
    Fabric,
    /// Porosity of the region.
    Porosity,
    /// Mean and scatter of normal forces.
    Forces,
    /// Form, strain and rate of the periodic cell.
    Cell,
    /// Energies, and the ledger of the whole world.
    Energy,
    /// Mass, centre of mass and its velocity.
    Motion,
    /// Force on some bodies together, and torque about a point (m).
    ForceOn(Vec<BodyId>, Vec3),
    /// What passes a plane.
    Plane(Plane),
    /// Lacey's index of these bodies among all that are meant, in cells of this edge, m.
    Mixing(Members, f64),
    /// Stresses and displacements of a shear box.
    ShearBox(ShearBox),
    /// The angle of a slope, by columns of this width, m.
    Repose(Along, f64),
    /// Fields in bins: a record per bin.
    Profile(Bins),
    /// Probability density of normal forces over their mean, in this many bins up to this ratio: a record per
    /// bin.
    Histogram(usize, f64),
    /// Bodies that came through streams and left through outlets.
    Exchange,
    /// Slip, sinkage, pull, load and torque of a wheel on the bodies that are meant.
    Wheel(Wheel),
}

/// A shear box: the part that moves, and the one that presses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShearBox {
    /// The body that is moved.
    pub sheared: BodyId,
    /// The body that presses.
    pub pressing: BodyId,
    /// Unit direction in which the first is moved.
    pub direction: Vec3,
    /// Unit direction from the sample to the second.
    pub normal: Vec3,
    /// Area of the sample, m^2.
    pub area: f64,
    /// A point of the plane between the halves, m.
    pub plane: Option<Vec3>,
}

/// A wheel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wheel {
    /// The body.
    pub body: BodyId,
    /// With which slip and sinkage count, m.
    pub radius: f64,
    /// Unit vector along its axis.
    pub axis: Vec3,
}

/// Bins beyond this many are a slip of the keyboard, whose records would take hundreds of megabytes.
pub(crate) const MOST_BINS: usize = 100_000;

impl Measure {
    /// Whether it names bodies and streams of a run that gave so many numbers, and bins that fit into memory:
    /// scenes give no other, a damaged file may.
    pub(crate) fn fits(&self, given: u64, streams: usize) -> bool {
        let known = |list: &[BodyId]| list.iter().all(|body| (body.index() as u64) < given);
        let members = |members: &Members| {
            known(&members.bodies) && members.streams.iter().all(|&stream| (stream as usize) < streams)
        };
        let quantity = |quantity: &Quantity| match quantity {
            Quantity::ForceOn(list, _) => known(list),
            Quantity::Mixing(first, _) => members(first),
            Quantity::Wheel(wheel) => known(&[wheel.body]),
            Quantity::ShearBox(shear) => known(&[shear.sheared, shear.pressing]),
            Quantity::Profile(bins) => (1..=MOST_BINS).contains(&bins.count),
            Quantity::Histogram(count, _) => (1..=MOST_BINS).contains(count),
            _ => true,
        };
        self.every > 0 && self.bodies.as_ref().is_none_or(members) && self.quantities.iter().all(quantity)
    }
}

/// What a measurement remembers from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeasureState {
    /// What has passed the plane since the start.
    pub passed: Passed,
    /// Time (s) and passed mass (kg) at the last record.
    pub last: Option<[f64; 2]>,
    /// Places of both parts of a shear box along its directions at the first record, m.
    pub origin: Option<[f64; 2]>,
}

/// What a record is made from.
#[derive(Clone, Copy)]
pub struct Measured<'a> {
    /// The state after the step.
    pub world: &'a World,
    /// Length of the step, s.
    pub step: f64,
    /// Number of the stage that the step belongs to.
    pub stage: usize,
    /// The ledger of all steps so far.
    pub ledger: &'a Ledger,
    /// Energy that removing overlap gave to bodies so far, J.
    pub correction_energy: f64,
    /// Bodies that came and went.
    pub open_boundaries: &'a OpenBoundaryState,
}

/// The first columns of every table.
const TIME: [Column; 2] =
    [column("step", "1", "number of the step, from 1"), column("time", "s", "at the end of the step")];

const STRESS: &[Column] = &[
    column("stress_xx", "Pa", "mean stress by contacts, compression positive"),
    column("stress_xy", "Pa", "first index: branch, second: force"),
    column("stress_xz", "Pa", "likewise"),
    column("stress_yx", "Pa", "likewise"),
    column("stress_yy", "Pa", "likewise"),
    column("stress_yz", "Pa", "likewise"),
    column("stress_zx", "Pa", "likewise"),
    column("stress_zy", "Pa", "likewise"),
    column("stress_zz", "Pa", "likewise"),
    column("pressure", "Pa", "a third of the trace"),
    column("deviator", "Pa", "sqrt(3/2 s:s) of the symmetric deviatoric part"),
    column("kinetic_pressure", "Pa", "pressure by fluctuations of velocity, not in the stress"),
    column("volume", "m^3", "of the region, or of the box around the bodies"),
];
const COORDINATION: &[Column] = &[
    column("bodies", "1", "bodies that are meant"),
    column("contacts", "1", "their contacts with force"),
    column("coordination", "1", "neighbours in contact per body"),
    column("rattlers", "1", "bodies held by too few others, found again without them until nothing changes"),
    column("coordination_without_rattlers", "1", "neighbours per body that is no rattler, without rattlers"),
    column("sliding", "1", "share of the contacts whose friction is used up"),
    column(
        "hyperstaticity",
        "1",
        "components of contact forces less equations of motion: above 0 forces are not unique",
    ),
];
const FABRIC: &[Column] = &[
    column("fabric_xx", "1", "mean of n n^T over the contacts with force"),
    column("fabric_yy", "1", "likewise"),
    column("fabric_zz", "1", "likewise"),
    column("fabric_xy", "1", "likewise"),
    column("fabric_xz", "1", "likewise"),
    column("fabric_yz", "1", "likewise"),
    column("anisotropy", "1", "sqrt(3/2 A:A), A = 15/2 (F - 1/3)"),
];
const POROSITY: &[Column] = &[
    column("porosity", "1", "share of the region (or of the box around the bodies) that no body fills"),
    column("solid_fraction", "1", "1 - porosity"),
];
const FORCES: &[Column] = &[
    column("force_count", "1", "contacts with force"),
    column("force_mean", "N", "mean normal force"),
    column("force_deviation", "N", "its standard deviation over the contacts"),
    column("force_max", "N", "largest normal force"),
    column("force_strong", "1", "share of the contacts above the mean"),
    column("force_participation", "1", "(sum f)^2 / (n sum f^2)"),
];
const CELL: &[Column] = &[
    column("cell_x", "m", "edge of the periodic cell along x"),
    column("cell_y", "m", "likewise along y"),
    column("cell_z", "m", "likewise along z"),
    column("tilt_xy", "m", "offset along x of the image one edge further along y"),
    column("tilt_xz", "m", "likewise of the one along z"),
    column("tilt_yz", "m", "offset along y of the image one edge further along z"),
    column("cell_volume", "m^3", "product of the edges"),
    column("strain_xx", "1", "logarithmic strain since the beginning, positive where stretched"),
    column("strain_yy", "1", "likewise"),
    column("strain_zz", "1", "likewise"),
    column("strain_xy", "1", "shear strain since the beginning"),
    column("strain_xz", "1", "likewise"),
    column("strain_yz", "1", "likewise"),
    column("rate_xx", "1/s", "velocity gradient at the end of the step, positive where stretched"),
    column("rate_yy", "1/s", "likewise"),
    column("rate_zz", "1/s", "likewise"),
    column("rate_xy", "1/s", "velocity along x per way along y"),
    column("rate_xz", "1/s", "likewise"),
    column("rate_yz", "1/s", "likewise"),
];
const ENERGY: &[Column] = &[
    column("kinetic", "J", "kinetic energy of the bodies that are meant"),
    column("translational", "J", "its translational part"),
    column("rotational", "J", "its rotational part"),
    column("potential", "J", "-m g . x"),
    column("work_gravity", "J", "of the whole world since the beginning: work of gravity"),
    column("work_loads", "J", "likewise: work of external forces and torques"),
    column("work_drives", "J", "likewise: work of prescribed motions"),
    column("work_joints", "J", "likewise: work of the motors, springs, dampers and stops of joints"),
    column("lost_friction", "J", "likewise: taken by friction"),
    column("lost_normal", "J", "likewise: taken by normal impulses"),
    column("overlap_energy", "J", "likewise: given against gravity by the removal of overlap"),
    column(
        "ledger_rest",
        "J",
        "likewise: change of kinetic energy less all work and losses; rounding for balls",
    ),
];
const MOTION: &[Column] = &[
    column("count", "1", "bodies that are meant"),
    column("mass", "kg", "their mass"),
    column("centre_x", "m", "their centre of mass"),
    column("centre_y", "m", "likewise"),
    column("centre_z", "m", "likewise"),
    column("velocity_x", "m/s", "its velocity"),
    column("velocity_y", "m/s", "likewise"),
    column("velocity_z", "m/s", "likewise"),
];
const FORCE_ON: &[Column] = &[
    column("force_x", "N", "force by contacts on the bodies together, mean over the step"),
    column("force_y", "N", "likewise"),
    column("force_z", "N", "likewise"),
    column("torque_x", "N m", "torque about the point"),
    column("torque_y", "N m", "likewise"),
    column("torque_z", "N m", "likewise"),
];
const PLANE: &[Column] = &[
    column("passed_mass", "kg", "mass that has passed along the normal since the start, less what came back"),
    column("passed_bodies", "1", "bodies likewise"),
    column("mass_flow", "kg/s", "mean since the record before"),
    column("through_x", "N", "force by contacts that what lies above receives through the plane"),
    column("through_y", "N", "likewise"),
    column("through_z", "N", "likewise"),
];
const MIXING: &[Column] = &[
    column("lacey", "1", "Lacey's index: 0 apart, 1 mixed at random"),
    column("mixing_share", "1", "share of the first kind"),
    column("mixing_cells", "1", "cells with a body"),
    column("mixing_bodies_per_cell", "1", "bodies per cell"),
];
const SHEAR_BOX: &[Column] = &[
    column("displacement", "m", "of the sheared part since the first record"),
    column("tau", "Pa", "shear stress: force against the motion over the area"),
    column("sigma", "Pa", "normal stress on the pressing part"),
    column("tau_over_sigma", "1", "their ratio"),
    column("friction_angle", "rad", "its arc tangent"),
    column("friction_angle_degrees", "deg", "the same in degrees"),
    column(
        "plane_tau",
        "Pa",
        "shear stress that the sample carries through the plane between the halves, by contacts of grains alone",
    ),
    column("plane_sigma", "Pa", "normal stress likewise"),
    column("plane_tau_over_sigma", "1", "their ratio: the strength of the grains, without walls"),
    column("plane_friction_angle_degrees", "deg", "its arc tangent in degrees"),
    column("dilation", "m", "way of the pressing part away from the sample since the first record"),
];
const WHEEL: &[Column] = &[
    column("slip", "1", "1 - v / (w R); empty where the wheel does not turn"),
    column("sinkage", "m", "of the circle of radius R below the median of the tops of the bed's columns"),
    column("drawbar_pull", "N", "force by contacts forward"),
    column("wheel_load", "N", "force by contacts upward"),
    column("drive_torque", "N m", "on the axis, against its contacts"),
    column("pull_over_load", "1", "drawbar pull over load"),
    column("tractive_efficiency", "1", "drawbar pull times speed over torque times rate"),
];
const REPOSE: &[Column] = &[
    column("repose_angle", "rad", "of the line through the tops of columns, positive where it falls outward"),
    column("repose_roughness", "m", "root mean square deviation of the tops from the line"),
    column("repose_columns", "1", "columns that it goes through"),
];
const PROFILE: &[Column] = &[
    column("bin", "1", "number of the bin, from 0"),
    column("middle", "m", "its middle"),
    column("bodies", "1", "bodies in it, by the part that is inside"),
    column("density", "kg/m^3", "mass over the volume of the bin"),
    column("solid_fraction", "1", "share of the bin that bodies fill"),
    column("velocity_x", "m/s", "mean by mass"),
    column("velocity_y", "m/s", "likewise"),
    column("velocity_z", "m/s", "likewise"),
    column("spin_x", "rad/s", "mean angular velocity by mass"),
    column("spin_y", "rad/s", "likewise"),
    column("spin_z", "rad/s", "likewise"),
    column("temperature", "m^2/s^2", "a third of the mean square deviation from the mean velocity"),
];
const EXCHANGE: &[Column] = &[
    column("entered_bodies", "1", "bodies that streams have given"),
    column("entered_mass", "kg", "their mass, and what bodies have grown by"),
    column("entered_energy", "J", "kinetic energy that they brought"),
    column("left_bodies", "1", "bodies that left through outlets"),
    column("left_mass", "kg", "their mass"),
    column("left_energy", "J", "kinetic energy that they took"),
    column("streams_waiting", "1", "streams with a body that finds no free place"),
];
const HISTOGRAM: &[Column] = &[
    column("bin", "1", "number of the bin, from 0"),
    column("force_ratio", "1", "middle of the bin: normal force over the mean"),
    column("probability_density", "1", "of that ratio"),
];

impl Quantity {
    fn columns(&self) -> &'static [Column] {
        match self {
            Self::Stress => STRESS,
            Self::Coordination(_) => COORDINATION,
            Self::Fabric => FABRIC,
            Self::Porosity => POROSITY,
            Self::Forces => FORCES,
            Self::Cell => CELL,
            Self::Energy => ENERGY,
            Self::Motion => MOTION,
            Self::ForceOn(..) => FORCE_ON,
            Self::Plane(_) => PLANE,
            Self::Mixing(..) => MIXING,
            Self::ShearBox(_) => SHEAR_BOX,
            Self::Wheel(_) => WHEEL,
            Self::Repose(..) => REPOSE,
            Self::Profile(_) => PROFILE,
            Self::Histogram(..) => HISTOGRAM,
            Self::Exchange => EXCHANGE,
        }
    }

    /// Whether it makes a record per bin, rather than one per time.
    pub fn has_bins(&self) -> bool {
        matches!(self, Self::Profile(_) | Self::Histogram(..))
    }

    /// The rows of its columns.
    fn rows(
        &self,
        measure: &Measure,
        meant: &[bool],
        now: Measured<'_>,
        state: &mut MeasureState,
    ) -> Vec<Vec<f64>> {
        let Measured { world, step, .. } = now;
        // The volume that the bodies have to themselves.
        let space = || measure.region.clone().or_else(|| own_space(world, meant));
        let row = match self {
            Self::Stress => {
                let volume = space().map_or(f64::NAN, |space| volume(&space));
                let found = stress(world, step, meant, volume);
                let contact = rows_of(&found.contact);
                let rest =
                    [pressure(&found.contact), deviator(&found.contact), pressure(&found.kinetic), volume];
                [contact.as_slice(), &rest].concat()
            }
            Self::Coordination(least) => {
                let found = coordination(world, meant, *least);
                vec![
                    found.bodies as f64,
                    found.contacts as f64,
                    found.mean,
                    found.rattlers as f64,
                    found.mean_without_rattlers,
                    found.sliding,
                    found.hyperstaticity as f64,
                ]
            }
            Self::Fabric => {
                let found = fabric(world, meant);
                let [x, y, z] = [found.x_axis, found.y_axis, found.z_axis];
                vec![x.x, y.y, z.z, y.x, z.x, z.y, anisotropy(&found)]
            }
            Self::Porosity => {
                let porosity = space().map_or(f64::NAN, |space| porosity(world, &space));
                vec![porosity, 1.0 - porosity]
            }
            Self::Forces => {
                let found = force_statistics(&normal_forces(world, step, meant));
                let count = found.count as f64;
                vec![count, found.mean, found.deviation, found.max, found.strong, found.participation]
            }
            Self::Cell => of_cell(world),
            Self::Energy => of_energy(now, meant),
            Self::Motion => motion(world, meant),
            Self::ForceOn(bodies, point) => {
                let bodies = now.open_boundaries.numbers.present(bodies);
                let (force, torque) = force_on(world, step, &bodies, measure.region.as_ref(), *point);
                [force.to_array(), torque.to_array()].concat()
            }
            Self::Plane(plane) => through(plane, now, state),
            Self::Mixing(first, cell) => {
                let first = now.open_boundaries.numbers.members(first);
                let found = lacey(world, meant, &among(world, &first), *cell);
                vec![found.index, found.share, found.cells as f64, found.bodies_per_cell]
            }
            Self::ShearBox(shear) => shear.row(now, state),
            Self::Wheel(wheel) => wheel.row(now, meant),
            Self::Repose(along, width) => {
                let found = slope(world, meant, *along, *width);
                vec![found.angle, found.roughness, found.columns as f64]
            }
            Self::Exchange => exchanged(now),
            Self::Profile(bins) => {
                let found = profile(world, meant, bins, measure.region.as_ref());
                let row = |(k, bin): (usize, &graintrain::measure::profile::Bin)| {
                    let begin = [k as f64, bin.middle, bin.bodies, bin.density, bin.solid];
                    let vectors = [bin.velocity.to_array(), bin.spin.to_array()].concat();
                    [begin.as_slice(), &vectors, &[bin.temperature]].concat()
                };
                return found.iter().enumerate().map(row).collect();
            }
            Self::Histogram(bins, most) => {
                let found = force_histogram(&normal_forces(world, step, meant), *bins, *most);
                let middle = |k: usize| (k as f64 + 0.5) * most / *bins as f64;
                return found.iter().enumerate().map(|(k, p)| vec![k as f64, middle(k), *p]).collect();
            }
        };
        vec![row]
    }
}

/// The row of [`Quantity::Cell`].
fn of_cell(world: &World) -> Vec<f64> {
    let Some(cell) = world.cell() else { return vec![f64::NAN; CELL.len()] };
    let form = cell.size.to_array().into_iter().chain(cell.tilt);
    form.chain([cell.volume()]).chain(cell.strain).chain(cell.rate).collect()
}

/// The row of [`Quantity::Energy`].
fn of_energy(now: Measured<'_>, meant: &[bool]) -> Vec<f64> {
    let found = energies(now.world, meant);
    let Ledger { gravity, loads, drives, joints, friction, normal, rest } = *now.ledger;
    vec![
        found.translational + found.rotational,
        found.translational,
        found.rotational,
        found.potential,
        gravity,
        loads,
        drives,
        joints,
        friction,
        normal,
        now.correction_energy,
        rest,
    ]
}

/// The row of [`Quantity::Plane`].
fn through(plane: &Plane, now: Measured<'_>, state: &mut MeasureState) -> Vec<f64> {
    let (time, mass) = (now.world.time, state.passed.mass);
    let flow = state.last.map_or(f64::NAN, |[t, m]| (mass - m) / (time - t));
    state.last = Some([time, mass]);
    let force = plane.force(now.world, now.step).to_array();
    [[mass, state.passed.bodies as f64, flow].as_slice(), &force].concat()
}

/// The row of [`Quantity::Exchange`].
fn exchanged(now: Measured<'_>) -> Vec<f64> {
    let amounts = [now.open_boundaries.entered(), now.open_boundaries.left()];
    let numbers = amounts.iter().flat_map(|a| [a.bodies as f64, a.mass, a.kinetic]);
    numbers.chain([now.open_boundaries.waiting() as f64]).collect()
}

/// The entries row by row.
fn rows_of(tensor: &Mat3) -> [f64; 9] {
    tensor.transpose().to_cols_array()
}

fn motion(world: &World, meant: &[bool]) -> Vec<f64> {
    let bodies = || (0..world.bodies.len()).filter(|&body| meant[body]);
    let mass: f64 = bodies().map(|body| world.bodies.mass[body]).sum();
    let momentum: Vec3 = bodies().map(|body| world.bodies.mass[body] * world.bodies.velocity[body]).sum();
    let centre = centre_of_mass(world, meant).unwrap_or(Vec3::NAN);
    let vectors = [centre.to_array(), (momentum / mass).to_array()].concat();
    [[bodies().count() as f64, mass].as_slice(), &vectors].concat()
}

impl Wheel {
    fn row(&self, now: Measured<'_>, meant: &[bool]) -> Vec<f64> {
        let rolling = Rolling { body: self.body, radius: self.radius, axis: self.axis };
        let found = wheel(now.world, now.step, &rolling, meant);
        let ratio = if found.load > 0.0 { found.pull / found.load } else { f64::NAN };
        vec![found.slip, found.sinkage, found.pull, found.load, found.torque, ratio, found.efficiency]
    }
}

impl ShearBox {
    fn row(&self, now: Measured<'_>, state: &mut MeasureState) -> Vec<f64> {
        let world = now.world;
        let force = |body: BodyId| force_on(world, now.step, &[body], None, Vec3::ZERO).0;
        let place = |body: BodyId, along: Vec3| world.bodies.position[body.index()].dot(along);
        let places = [place(self.sheared, self.direction), place(self.pressing, self.normal)];
        let origin = *state.origin.get_or_insert(places);
        let tau = -force(self.sheared).dot(self.direction) / self.area;
        let sigma = force(self.pressing).dot(self.normal) / self.area;
        let ratio = if sigma > 0.0 { tau / sigma } else { f64::NAN };
        // What lies above receives the force; the sheared half below drags it along its direction.
        let [plane_tau, plane_sigma] = self.plane.map_or([f64::NAN; 2], |point| {
            let plane = Plane { point, normal: self.normal, region: None };
            let force = plane.force_in_sample(world, now.step) / self.area;
            [force.dot(self.direction), force.dot(self.normal)]
        });
        let plane_ratio = if plane_sigma > 0.0 { plane_tau / plane_sigma } else { f64::NAN };
        let dilation = places[1] - origin[1];
        vec![
            places[0] - origin[0],
            tau,
            sigma,
            ratio,
            real::atan(ratio),
            real::atan(ratio).to_degrees(),
            plane_tau,
            plane_sigma,
            plane_ratio,
            real::atan(plane_ratio).to_degrees(),
            dilation,
        ]
    }
}

impl Measure {
    /// Columns of its table.
    pub fn columns(&self) -> Vec<Column> {
        let mut columns = TIME.to_vec();
        columns.extend(self.quantities.iter().flat_map(|quantity| quantity.columns()));
        columns
    }

    /// Whether it needs the places of bodies before a step.
    pub fn follows_bodies(&self) -> bool {
        self.quantities.iter().any(|quantity| matches!(quantity, Quantity::Plane(_)))
    }

    /// Which bodies are meant.
    fn meant(&self, world: &World, numbers: &BodyNumbers, region: Option<&Region>) -> Vec<bool> {
        let bodies = self.bodies.as_ref().map(|members| numbers.members(members));
        selected(world, bodies.as_deref(), region)
    }

    /// Counts what a step did to the bodies whose centres were at `before` (m).
    pub fn follow(&self, now: Measured<'_>, before: &[Vec3], state: &mut MeasureState) {
        let Measured { world, stage, .. } = now;
        if world.step < self.start || self.stage.is_some_and(|only| only != stage) {
            return;
        }
        for quantity in &self.quantities {
            if let Quantity::Plane(plane) = quantity {
                let meant = self.meant(world, &now.open_boundaries.numbers, None);
                let passed = plane.passed(world, before, &meant);
                state.passed.mass += passed.mass;
                state.passed.bodies += passed.bodies;
            }
        }
    }

    /// The rows of its columns (step and time among them) after the step that was just made; `None` where
    /// there is no record due.
    pub fn record(&self, now: Measured<'_>, state: &mut MeasureState) -> Option<Vec<Vec<f64>>> {
        let number = now.world.step;
        if self.stage.is_some_and(|only| only != now.stage) {
            return None;
        }
        if number < self.start || !(number - self.start).is_multiple_of(self.every.max(1)) {
            return None;
        }
        let meant = self.meant(now.world, &now.open_boundaries.numbers, self.region.as_ref());
        let begin = vec![vec![number as f64, now.world.time]];
        Some(self.quantities.iter().fold(begin, |rows, quantity| {
            let more = quantity.rows(self, &meant, now, state);
            // Every row of bins begins with step and time; quantities without bins have one row.
            more.iter().map(|more| [rows[0].as_slice(), more].concat()).collect()
        }))
    }
}
