//! Solvers by name: the methods, their linear solvers, and what it takes to make them.

use crate::newton::NewtonSolver;
use crate::newton::body::{BodyCg, BodyCholesky};
use crate::newton::direct::{Direct, SchurCholesky};
use crate::newton::incomplete::IncompleteCholeskyCg;
use crate::newton::krylov::SchurKrylov;
#[cfg(feature = "paper")]
use crate::paper::{
    BarzilaiBorwein, GpMinres, Jacobi, Kucera, SpectralProjectedGradient,
    pdip::{Pdip, Rule},
    scip::Scip,
    train::TensorTrain,
    train_schur::TrainSchur,
};
use crate::problem::CcpError;
use crate::solver::first_order::FirstOrder;
use crate::solver::ipm::Ipm;
use crate::solver::{AcceleratedSweeps, Apgd, Cascade, CcpSolver, GaussSeidel, PathFollowing};
use std::fmt;
use std::str::FromStr;

/// The cargo feature that [`Method`]s and [`LinearMethod`]s of the paper need.
const PAPER: &str = "paper";

/// Whether lists of solvers for users show it; the others are for experiments.
const LISTED: bool = true;
const HIDDEN: bool = false;
/// Whether it is compiled in.
const ALWAYS: bool = true;
const WITH_PAPER: bool = cfg!(feature = "paper");

/// Defines a list of names: in each row a variant, its name, and whatever else is known of it.
macro_rules! names {
    ($(#[$meta:meta])* $list:ident of $row:ty: $(
        $(#[$of:meta])* $variant:ident $({ $($(#[$doc:meta])* $field:ident: $kind:ty = $usual:expr),+ })?
            = $name:literal, $columns:expr;
    )+) => {
        $(#[$meta])*
        pub enum $list {
            $(#[doc = concat!("`", $name, "`.")] $(#[$of])* $variant $({ $($(#[$doc])* $field: $kind),+ })?,)+
        }

        impl $list {
            /// All of them, in the order of the documentation.
            pub const ALL: [Self; [$($name),+].len()] =
                [$(Self::$variant $({ $($field: $usual),+ })?,)+];

            /// Those that are compiled in.
            pub fn available() -> impl Iterator<Item = Self> {
                Self::ALL.into_iter().filter(|one| one.is_available())
            }

            /// Name on the command line, without settings; that of a linear solver follows a `+`.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant { .. } => $name,)+
                }
            }

            fn row(self) -> $row {
                match self {
                    $(Self::$variant { .. } => $columns,)+
                }
            }
        }
    };
}

names! {
    /// A method for the CCP.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    Method of (bool, bool, &'static str):
    #[default]
    Auto = "auto", (LISTED, ALWAYS,
        "exact friction: apgs and others in turn; relaxed: apgd, and the interior point where that is better");
    Jacobi = "pj", (LISTED, WITH_PAPER, "projected Jacobi (Tasora, Anitescu 2011)");
    GaussSeidel = "pgs", (LISTED, ALWAYS,
        "projected Gauss-Seidel (Tasora, Anitescu 2011); pgs@1.3: with over-relaxation 1.3 (SOR)");
    AcceleratedSweeps = "apgs", (LISTED, ALWAYS, "projected Gauss-Seidel with Nesterov's momentum");
    Apgd = "apgd", (LISTED, ALWAYS,
        "accelerated projected gradient descent (Mazhar, Heyn, Negrut, Tasora 2015)");
    BarzilaiBorwein = "bb", (LISTED, WITH_PAPER,
        "projected Barzilai-Borwein gradient (Barzilai, Borwein 1988; Dai, Fletcher 2005)");
    Kucera = "kucera", (LISTED, WITH_PAPER,
        "projected conjugate gradients with expansion and proportioning (Kucera 2008)");
    SpectralProjectedGradient = "spg", (LISTED, WITH_PAPER,
        "preconditioned spectral projected gradient with fallback, P-SPG-FB (Heyn 2013)");
    GpMinres = "gpminres", (LISTED, WITH_PAPER,
        "gradient-projected minimum residual (Heyn, Anitescu, Tasora, Negrut 2013)");
    Scip = "scip", (LISTED, WITH_PAPER,
        "symmetric cone interior point (Kleinert, Simeon, Obermayr 2014); linear solver after a '+'");
    Ipm = "ipm", (LISTED, ALWAYS,
        "projected gradients, Newton on the projection, interior point; ipm+LINEAR: the interior point alone");
    PathFollowing = "path", (LISTED, ALWAYS,
        "follows the smoothed path of the exact friction problem around its folds, one sparse LU per step");
    Pdip = "pdip", (LISTED, WITH_PAPER,
        "primal-dual interior point of the paper (Corona et al. 2019); linear solver after a '+'");
    PdipLiteral = "pdip-literal", (HIDDEN, WITH_PAPER,
        "the same with the paper's own start, barrier and step rules, which stall on settled packings");
}

impl Method {
    /// One line for `--help`.
    pub fn about(self) -> &'static str {
        self.row().2
    }

    /// Whether lists of solvers for users show it; the others are for experiments.
    pub fn is_listed(self) -> bool {
        self.row().0
    }

    /// Whether it solves linear systems, so that the name of a linear solver may follow a `+`.
    pub fn has_linear_solver(self) -> bool {
        matches!(self, Self::Scip | Self::Ipm | Self::Pdip | Self::PdipLiteral)
    }

    /// Whether it is compiled in: `auto`, `pgs`, `apgs`, `apgd`, `ipm` and `path` always, the others with the
    /// feature `paper`.
    pub fn is_available(self) -> bool {
        self.row().1
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Accuracy and rank cap of the paper's best preconditioner, that of a `tt-cross` without settings.
const CROSS: (f64, usize) = (1e-2, 10);

names! {
    /// A linear solver of Newton systems (see [`crate::newton`]).
    #[derive(Clone, Copy, Debug, PartialEq)]
    LinearMethod of (bool, bool):
    Plain = "none", (LISTED, ALWAYS);
    IncompleteLu = "ilu", (LISTED, ALWAYS);
    IncompleteCholesky = "ic", (LISTED, ALWAYS);
    SchurIncompleteCholesky = "schur-ic", (HIDDEN, ALWAYS);
    BodyIncompleteCholesky = "body-ic", (HIDDEN, ALWAYS);
    BlockJacobi = "block-jacobi", (LISTED, ALWAYS);
    Cholesky = "cholesky", (LISTED, ALWAYS);
    SchurCholesky = "schur-cholesky", (HIDDEN, ALWAYS);
    BodyCholesky = "body-cholesky", (HIDDEN, ALWAYS);
    BodyCg = "body-cg", (LISTED, ALWAYS);
    TensorTrain = "tt", (LISTED, WITH_PAPER);
    TensorTrainSchur = "tt-schur", (LISTED, WITH_PAPER);
    /// With settings: `tt-cross@ACCURACY:RANK`.
    TensorTrainCross {
        /// Accuracy of the compressed inverse, between 0 and 1.
        accuracy: f64 = CROSS.0,
        /// Largest rank, at least 1.
        max_rank: usize = CROSS.1
    } = "tt-cross", (LISTED, WITH_PAPER);
}

impl LinearMethod {
    /// Whether lists of solvers for users show it: the halves of `ic` and `cholesky`, which choose between
    /// contact space and body space themselves, are for experiments.
    pub fn is_listed(self) -> bool {
        self.row().0
    }

    /// Whether it is compiled in: those with a tensor train need the feature `paper`.
    pub fn is_available(self) -> bool {
        self.row().1
    }

    /// The linear solver that follows `method` and a `+`; `tt-cross@1e-3:100` is `tt-cross` at accuracy 1e-3
    /// with ranks up to 100. A comma or a slash will do as well as the colon, but lists of solvers are split
    /// at commas.
    ///
    /// # Errors
    /// [`CcpError::UnknownSolver`], or [`CcpError::NotCompiled`] where the feature `paper` is off.
    pub fn of(method: Method, name: &str) -> Result<Self, CcpError> {
        let found = match name.strip_prefix("tt-cross@") {
            Some(settings) => cross(settings),
            None => Self::ALL.into_iter().find(|linear| linear.name() == name),
        };
        let Some(linear) = found else {
            let listed = Self::available().filter(|linear| linear.is_listed());
            let mut known: Vec<String> = listed.map(|linear| format!("{method}+{}", linear.name())).collect();
            if cfg!(feature = "paper") {
                known.push(format!("{method}+tt-cross@ACCURACY:RANK"));
            }
            return Err(CcpError::UnknownSolver {
                name: format!("{method}+{name}"),
                known: known.join(", "),
            });
        };
        if linear.is_available() { Ok(linear) } else { Err(not_compiled(format!("{method}+{name}"))) }
    }

    /// Makes the linear solver.
    ///
    /// # Errors
    /// [`CcpError::NotCompiled`] where the feature `paper` is off and it needs a tensor train.
    pub fn build(self) -> Result<Box<dyn NewtonSolver>, CcpError> {
        Ok(match self {
            Self::Plain => Box::new(SchurKrylov::plain()),
            Self::IncompleteLu => Box::new(SchurKrylov::incomplete_lu()),
            Self::IncompleteCholesky => Box::new(IncompleteCholeskyCg::default()),
            Self::SchurIncompleteCholesky => Box::new(SchurKrylov::incomplete_cholesky()),
            Self::BodyIncompleteCholesky => Box::new(BodyCg::incomplete_cholesky()),
            Self::BlockJacobi => Box::new(SchurKrylov::block_jacobi()),
            Self::Cholesky => Box::new(Direct::default()),
            Self::SchurCholesky => Box::new(SchurCholesky::default()),
            Self::BodyCholesky => Box::new(BodyCholesky::default()),
            Self::BodyCg => Box::new(BodyCg::block_jacobi()),
            #[cfg(feature = "paper")]
            Self::TensorTrain => Box::new(TensorTrain::default()),
            #[cfg(feature = "paper")]
            Self::TensorTrainSchur => Box::new(TrainSchur::scaled()),
            #[cfg(feature = "paper")]
            Self::TensorTrainCross { accuracy, max_rank } => {
                Box::new(TrainSchur::literal_at(accuracy, max_rank))
            }
            #[cfg(not(feature = "paper"))]
            Self::TensorTrain | Self::TensorTrainSchur | Self::TensorTrainCross { .. } => {
                return Err(not_compiled(self.to_string()));
            }
        })
    }
}

/// `ACCURACY:RANK` with 0 < ACCURACY < 1 and RANK > 0.
fn cross(settings: &str) -> Option<LinearMethod> {
    let (accuracy, max_rank) = settings.split_once([':', ',', '/'])?;
    let (accuracy, max_rank) = (accuracy.parse::<f64>().ok()?, max_rank.parse::<usize>().ok()?);
    let valid = accuracy > 0.0 && accuracy < 1.0 && max_rank > 0;
    valid.then_some(LinearMethod::TensorTrainCross { accuracy, max_rank })
}

impl fmt::Display for LinearMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TensorTrainCross { accuracy, max_rank } if (accuracy, max_rank) != CROSS => {
                write!(f, "tt-cross@{accuracy:e}:{max_rank}")
            }
            linear => f.write_str(linear.name()),
        }
    }
}

/// A solver by name: a method, and for second-order methods its linear solver after a `+`, e.g. `pdip+ilu`;
/// over-relaxation follows `pgs` after an `@`, e.g. `pgs@1.3`.
///
/// ```
/// use graintrain_ccp::SolverSpec;
/// let spec: SolverSpec = "ipm+ic".parse()?;
/// assert_eq!(spec.to_string(), "ipm+ic");
/// assert!("ipm+typo".parse::<SolverSpec>().is_err());
/// # Ok::<(), graintrain_ccp::CcpError>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct SolverSpec {
    method: Method,
    /// omega of `pgs@OMEGA`.
    relaxation: Option<f64>,
    linear: Option<LinearMethod>,
}

impl From<Method> for SolverSpec {
    /// The method as it is without further settings.
    fn from(method: Method) -> Self {
        Self { method, relaxation: None, linear: None }
    }
}

impl SolverSpec {
    /// Whether the method re-uses what it made for one problem in the next, so that it has to be given whole
    /// steps rather than the connected parts of them: the interior points with a linear solver of their own
    /// (Algorithm 3 of the paper).
    pub fn keeps_between_steps(&self) -> bool {
        self.linear.is_some() || matches!(self.method, Method::Pdip | Method::PdipLiteral | Method::Scip)
    }

    /// Makes the solver, for relaxed and for exact friction.
    ///
    /// # Errors
    /// [`CcpError::NotCompiled`] where the feature `paper` is off and it is needed.
    pub fn build(&self) -> Result<Box<dyn CcpSolver>, CcpError> {
        let relaxed: Box<dyn CcpSolver> = match (self.method, self.linear) {
            (Method::Auto, _) => return Ok(Box::new(Cascade::auto())),
            (Method::GaussSeidel, _) => {
                let relaxation = self.relaxation.unwrap_or(GaussSeidel::default().relaxation);
                Box::new(FirstOrder::new(GaussSeidel { relaxation }))
            }
            (Method::AcceleratedSweeps, _) => Box::new(FirstOrder::new(AcceleratedSweeps::default())),
            (Method::Apgd, _) => Box::new(FirstOrder::new(Apgd::default())),
            (Method::Ipm, None) => return Ok(Box::new(Cascade::interior_point())),
            // It treats exact friction itself, and what it cannot solve no sequence of relaxed problems
            // solved by it can.
            (Method::PathFollowing, _) => {
                return Ok(Box::new(Cascade::of_exact(Box::new(PathFollowing::default()))));
            }
            (Method::Ipm, Some(linear)) => Box::new(Ipm::with_solver(linear.build()?)),
            (method, linear) => of_paper(method, linear.unwrap_or(LinearMethod::Cholesky))?,
        };
        Ok(Box::new(Cascade::of(relaxed)))
    }
}

/// The methods that production does not need.
#[cfg(feature = "paper")]
fn of_paper(method: Method, linear: LinearMethod) -> Result<Box<dyn CcpSolver>, CcpError> {
    Ok(match method {
        Method::Jacobi => Box::new(FirstOrder::new(Jacobi)),
        Method::BarzilaiBorwein => Box::new(FirstOrder::new(BarzilaiBorwein)),
        Method::Kucera => Box::new(FirstOrder::new(Kucera)),
        Method::SpectralProjectedGradient => Box::new(FirstOrder::new(SpectralProjectedGradient)),
        Method::GpMinres => Box::new(FirstOrder::new(GpMinres)),
        Method::Scip => Box::new(Scip::with_solver(linear.build()?)),
        Method::Pdip => Box::new(Pdip::with_solver(Rule::Central, linear.build()?)),
        Method::PdipLiteral => Box::new(Pdip::with_solver(Rule::Paper, linear.build()?)),
        other => return SolverSpec::from(other).build(),
    })
}

#[cfg(not(feature = "paper"))]
fn of_paper(method: Method, _: LinearMethod) -> Result<Box<dyn CcpSolver>, CcpError> {
    Err(not_compiled(method.to_string()))
}

fn not_compiled(name: String) -> CcpError {
    CcpError::NotCompiled { name, feature: PAPER }
}

impl fmt::Display for SolverSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.method.name())?;
        if let Some(omega) = self.relaxation {
            write!(f, "@{omega}")?;
        }
        self.linear.map_or(Ok(()), |linear| write!(f, "+{linear}"))
    }
}

impl From<SolverSpec> for String {
    fn from(spec: SolverSpec) -> Self {
        spec.to_string()
    }
}

impl TryFrom<String> for SolverSpec {
    type Error = CcpError;

    fn try_from(name: String) -> Result<Self, CcpError> {
        name.parse()
    }
}

impl FromStr for SolverSpec {
    type Err = CcpError;

    /// # Errors
    /// [`CcpError::UnknownSolver`] where no method or linear solver has the name, [`CcpError::NotCompiled`]
    /// where one has and the feature `paper` is off.
    fn from_str(name: &str) -> Result<Self, CcpError> {
        let unknown = |known: String| CcpError::UnknownSolver { name: name.to_string(), known };
        let (head, linear) = name.split_once('+').map_or((name, None), |(head, linear)| (head, Some(linear)));
        let (head, omega) = head.split_once('@').map_or((head, None), |(head, omega)| (head, Some(omega)));
        let Some(method) = Method::ALL.into_iter().find(|method| method.name() == head) else {
            let listed = Method::available().filter(|method| method.is_listed());
            return Err(unknown(listed.map(Method::name).collect::<Vec<_>>().join(", ")));
        };
        if !method.is_available() {
            return Err(not_compiled(name.to_string()));
        }
        let relaxation = match omega {
            None => None,
            Some(_) if method != Method::GaussSeidel => {
                return Err(unknown(format!("{method} (only pgs takes a number after an '@')")));
            }
            Some(omega) => {
                let valid = omega.parse().ok().filter(|omega| *omega > 0.0 && *omega < 2.0);
                let known = || unknown("pgs@OMEGA with a number OMEGA between 0 and 2".to_string());
                Some(valid.ok_or_else(known)?)
            }
        };
        let linear = match linear {
            None => None,
            Some(_) if !method.has_linear_solver() => {
                return Err(unknown(format!(
                    "{method} (it solves no linear systems, so nothing follows a '+')"
                )));
            }
            Some(linear) => Some(LinearMethod::of(method, linear)?),
        };
        Ok(Self { method, relaxation, linear })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_themselves_or_say_which_feature_they_need() {
        for method in Method::ALL {
            match method.name().parse::<SolverSpec>() {
                Ok(spec) => {
                    assert!(method.is_available());
                    assert_eq!((spec, spec.to_string().as_str()), (method.into(), method.name()));
                    assert!(spec.build().is_ok(), "{method}");
                }
                Err(error) => {
                    assert!(!method.is_available());
                    assert!(error.to_string().contains("feature 'paper'"), "{error}");
                }
            }
        }
        for linear in LinearMethod::ALL {
            match format!("ipm+{linear}").parse::<SolverSpec>() {
                Ok(spec) => assert_eq!(spec.to_string(), format!("ipm+{linear}")),
                Err(error) => {
                    assert!(!linear.is_available());
                    assert!(error.to_string().contains("feature 'paper'"), "{error}");
                }
            }
        }
    }

    #[test]
    fn what_is_not_a_solver_is_refused() {
        for name in ["", "ipn", "auto+ic", "apgd@1.3", "pgs@2", "pgs@x", "ipm+typo", "ipm+tt-cross@2:10"] {
            let error = name.parse::<SolverSpec>().unwrap_err();
            assert!(matches!(error, CcpError::UnknownSolver { .. }), "{name}: {error}");
        }
        assert_eq!("pgs@1.3".parse::<SolverSpec>().unwrap().to_string(), "pgs@1.3");
    }
}
