#!/usr/bin/env python3
"""Tensor-train operations of graintrain-tt beside other libraries, on the same tensors and accuracies.

Prints one table for one thread and one for two. Times on one thread are processor times (which other programs disturb little),
on several threads wall times. Needs cargo; whatever else is there is used:
  pip install numpy teneva torchTT           (Python libraries)
  octave on the path and TT_TOOLBOX=<folder of TT-Toolbox> (with its MEX solver if it is built; needs numpy)
Usage: benches/peers/tensor_trains.py [threads ...]
"""
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.join(HERE, "..", "..")


def clock():
    return time.process_time() if os.environ.get("OMP_NUM_THREADS") == "1" else time.perf_counter()


def best_of(run, error=None):
    """Fastest of at least three runs, within about a second; the last result's error."""
    best, spent, count, result = float("inf"), 0.0, 0, None
    while count < 3 or (spent < 1.0 and count < 2000):
        start = clock()
        result = run()
        seconds = clock() - start
        best, spent, count = min(best, seconds), spent + seconds, count + 1
        if spent > 60:
            break
    return best, (error(result) if error else 0.0)


def emit(name, run, error=None):
    try:
        seconds, size = best_of(run, error)
        print(json.dumps({"operation": name, "seconds": seconds, "error": float(size)}), flush=True)
    except Exception as fault:  # a peer may lack or fail an operation: the table shows a gap
        print(json.dumps({"operation": name, "failed": repr(fault)[:200]}), flush=True)


def number(n):
    """The fixed sequence of the Rust bench (SplitMix64), in [-1, 1)."""
    import numpy as np
    with np.errstate(over="ignore"):
        z = n.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = (z ^ (z >> np.uint64(31))) >> np.uint64(11)
    return z.astype(np.float64) / 2.0**52 - 1.0


def train(d, mode, rank, seed):
    import numpy as np
    cores, n = [], seed
    for k in range(d):
        shape = (1 if k == 0 else rank, mode, 1 if k + 1 == d else rank)
        size = shape[0] * shape[1] * shape[2]
        # Scaled to a norm near 1, as in the Rust bench.
        scale = np.sqrt(3.0 / (mode * rank))
        cores.append(scale * number(np.arange(n + 1, n + 1 + size)).reshape(shape, order="F"))
        n += size
    return cores


def sampled_function():
    import numpy as np
    i = np.arange(2**20, dtype=float)
    return np.sin(1e-3 * i) + 1.0 / (1.0 + i)


def matrix_cores(cores):
    """(r, 4, r') to (r, 2, 2, r'), the row digit fastest."""
    return [c.reshape((c.shape[0], 2, 2, c.shape[2]), order="F") for c in cores]


def run_teneva():
    import numpy as np
    import teneva
    x, y = train(20, 4, 32, 1_000_000), train(20, 4, 32, 2_000_000)
    twice = teneva.mul(x, 2.0)
    total = teneva.add(x, x)
    # (Its norm comes from an inner product and cannot resolve differences below 1e-8.)
    emit("round 4^20, rank 64 to 32", lambda: teneva.truncate(total, 1e-10, is_eigh=False), lambda r: teneva.norm(teneva.sub(r, twice)) / teneva.norm(twice))
    emit("dot 4^20, rank 32", lambda: teneva.mul_scalar(x, y))
    emit("norm 4^20, rank 32", lambda: teneva.norm(x))
    emit("add 4^20, rank 32", lambda: teneva.add(x, y))
    a, b = train(20, 4, 8, 3_000_000), train(20, 4, 8, 4_000_000)
    emit("hadamard 4^20, rank 8 x 8", lambda: teneva.mul(a, b))
    full = sampled_function().reshape([2] * 20, order="F")
    size = np.linalg.norm(full)
    emit("TT-SVD 2^20 to 1e-8", lambda: teneva.svd(full, 1e-8), lambda t: np.linalg.norm(teneva.full(t) - full) / size)
    points = ((number(np.arange(20 * 100_000)) + 1.0) * 2.0).astype(int).reshape(-1, 20)
    emit("100000 entries of 4^20, rank 32", lambda: teneva.get_many(x, points))
    hilbert = lambda index: 1.0 / (6.0 + np.sum(index, axis=1))
    sample = np.random.default_rng(1).integers(0, 32, (2000, 6))
    values = hilbert(sample)
    def cross():
        start = teneva.rand([32] * 6, 2, seed=1)
        return teneva.cross(hilbert, start, e=1e-6, nswp=20, dr_max=2)
    measured = lambda t: np.linalg.norm(teneva.get_many(t, sample) - values) / np.linalg.norm(values)
    emit("cross, Hilbert tensor 32^6 to 1e-6", cross, measured)


def run_torchtt(threads):
    warnings.simplefilter("ignore")
    import numpy as np
    import torch
    import torchtt
    torch.set_num_threads(threads)
    make = lambda cores: torchtt.TT([torch.tensor(np.ascontiguousarray(c)) for c in cores])
    x, y = make(train(20, 4, 32, 1_000_000)), make(train(20, 4, 32, 2_000_000))
    total, twice = x + x, 2.0 * x
    distance = lambda a, b: float((a - b).norm() / b.norm())
    emit("round 4^20, rank 64 to 32", lambda: total.round(1e-10), lambda r: distance(r, twice))
    emit("dot 4^20, rank 32", lambda: torchtt.dot(x, y))
    emit("norm 4^20, rank 32", lambda: x.norm())
    emit("add 4^20, rank 32", lambda: x + y)
    a, b = make(train(20, 4, 8, 3_000_000)), make(train(20, 4, 8, 4_000_000))
    emit("hadamard 4^20, rank 8 x 8", lambda: a * b)
    full = torch.tensor(np.ascontiguousarray(sampled_function().reshape([2] * 20, order="F")))
    size = float(torch.linalg.norm(full.flatten()))
    emit("TT-SVD 2^20 to 1e-8", lambda: torchtt.TT(full, eps=1e-8),
         lambda t: float(torch.linalg.norm((t.full() - full).flatten())) / size)
    points = torch.tensor(((number(np.arange(20 * 100_000)) + 1.0) * 2.0).astype(int).reshape(-1, 20))
    emit("100000 entries of 4^20, rank 32", lambda: x.apply_mask(points))
    operator, small = make(matrix_cores(train(20, 4, 4, 5_000_000))), make(train(20, 2, 16, 6_000_000))
    emit("TT-matrix x TT-vector 2^20, rank 4 x 16", lambda: operator @ small)
    emit("TT-matrix x TT-matrix 2^20, rank 4 x 4", lambda: operator @ operator)
    matrix = make(matrix_cores(train(16, 4, 10, 7_000_000)))
    vector = torch.tensor(number(np.arange(2**16) + 8_000_000).reshape([2] * 16, order="F").copy())
    emit("TT-matrix x full vector 2^16, rank 10", lambda: matrix @ vector)
    for dimension in (2, 3):
        terms = [make(cores) for cores in poisson_cores(dimension)]
        system = terms[0]
        for term in terms[1:]:
            system = (system + term).round(1e-14)
        rhs = torchtt.ones([2] * (6 * dimension), dtype=torch.float64)
        solve = lambda: torchtt.solvers.amen_solve(system, rhs, x0=rhs, eps=1e-6, nswp=40, use_cpp=True)
        emit(f"AMEn solve, Poisson 64^{dimension} to 1e-6", solve,
             lambda u: float((system @ u - rhs).norm() / rhs.norm()))
    hilbert = lambda index: 1.0 / (6.0 + torch.sum(index, dim=1).to(torch.float64))
    sample = torch.tensor(np.random.default_rng(1).integers(0, 32, (2000, 6)))
    values = hilbert(sample)
    emit("cross, Hilbert tensor 32^6 to 1e-6",
         lambda: torchtt.interpolate.dmrg_cross(hilbert, [32] * 6, eps=1e-6, nswp=20),
         lambda t: float(torch.linalg.norm(t.apply_mask(sample) - values) / torch.linalg.norm(values)))


OCTAVE = r"""
% The toolbox of Oseledets and others, from the folder TT_TOOLBOX; trains of the Rust bench from the folder TRAINS.
addpath(genpath(getenv('TT_TOOLBOX')));
maxNumCompThreads(str2double(getenv('OMP_NUM_THREADS')));
function t = train(name)
  f = fopen([getenv('TRAINS') '/' name], 'r'); d = fread(f, 1, 'int64'); cores = cell(d, 1);
  for k = 1:d
    s = fread(f, 3, 'int64'); cores{k} = reshape(fread(f, prod(s), 'double'), s(1), s(2), s(3));
  end
  fclose(f); t = cell2core(tt_tensor, cores);
end
function t = scaled(x, a)
  c = core2cell(x); c{1} = a * c{1}; t = cell2core(tt_tensor, c);
end
function result = report(name, f, measure)
  best = inf; spent = 0; count = 0; one = strcmp(getenv('OMP_NUM_THREADS'), '1');
  while count < 3 || (spent < 1 && count < 50)
    if one, t = cputime; result = f(); s = cputime - t; else, tic; result = f(); s = toc; end
    best = min(best, s); spent += s; count += 1;
    if spent > 60, break; end
  end
  printf('{"operation": "%s", "seconds": %g, "error": %g}\n', name, best, measure(result)); fflush(stdout);
end
function values = entries(t, points)
  c = core2cell(t); values = zeros(rows(points), 1);
  for p = 1:rows(points)
    v = 1;
    for k = 1:numel(c), v = v * reshape(c{k}(:, points(p, k), :), size(c{k}, 1), size(c{k}, 3)); end
    values(p) = v;
  end
end
none = @(r) 0;
x = train('x'); y = train('y'); s = plus(x, x); twice = scaled(x, 2);
report('round 4^20, rank 64 to 32', @() round(s, 1e-10), @(r) norm(plus(r, scaled(twice, -1))) / norm(twice));
report('dot 4^20, rank 32', @() dot(x, y), none);
report('norm 4^20, rank 32', @() norm(x), none);
report('add 4^20, rank 32', @() plus(x, y), none);
a = train('a'); b = train('b');
report('hadamard 4^20, rank 8 x 8', @() times(a, b), none);
i = (0:2^20-1)'; full = reshape(sin(1e-3*i) + 1./(1+i), 2*ones(1,20));
report('TT-SVD 2^20 to 1e-8', @() tt_tensor(full, 1e-8), none);
A = tt_matrix(train('operator'), 2, 2); v = train('small');
report('TT-matrix x TT-vector 2^20, rank 4 x 16', @() mtimes(A, v), none);
report('TT-matrix x TT-matrix 2^20, rank 4 x 4', @() mtimes(A, A), none);
M = tt_matrix(train('matrix'), 2, 2); w = rand(2^16, 1);
report('TT-matrix x full vector 2^16, rank 10', @() mtimes(M, w), none);
mex_is_there = exist('solve3d_2') == 3;
for D = [2 3]
  L = tt_matrix(train(sprintf('poisson%d', D)), 2, 2); f = train(sprintf('ones%d', D)); z = train(sprintf('start%d', D));
  run = @() amen_solve2(L, f, 1e-6, 'x0', f, 'z0', z, 'verb', 0, 'ismex', mex_is_there);
  report(sprintf('AMEn solve, Poisson 64^%d to 1e-6', D), run, @(u) norm(plus(mtimes(L, u), scaled(f, -1))) / norm(f));
end
if exist('amen_cross')
  f = @() amen_cross(32*ones(6,1), @(i) 1./sum(i, 2), 1e-6, 'vec', true, 'verb', 0);
  points = randi(32, 2000, 6); values = 1 ./ sum(points, 2);
  report('cross, Hilbert tensor 32^6 to 1e-6', f, @(t) norm(entries(t, points) - values) / norm(values));
end
"""


def poisson_cores(dimension):
    """The Laplacian of 64^D points, separated digits, explicit ranks of Kazeev and Khoromskij: (r, i, j, r') cores."""
    import numpy as np
    eye, up = np.eye(2), np.array([[0.0, 1.0], [0.0, 0.0]])
    low, zero, scale = up.T, np.zeros((2, 2)), 65.0**2
    rows = lambda block: np.array(block).transpose(1, 2, 3, 0)  # (left, right, i, j) coarsest first, turned
    first = rows([[eye, low, up]])
    middle = rows([[eye, low, up], [zero, up, zero], [zero, zero, low]])
    last = rows([[scale * (2 * eye - low - up)], [-scale * up], [-scale * low]])
    line = [last, middle, middle, middle, middle, first]
    identity = [np.eye(2).reshape(1, 2, 2, 1)] * 6
    return [sum([line if a == b else identity for b in range(dimension)], []) for a in range(dimension)]


def write_train(folder, name, cores):
    import numpy as np
    with open(os.path.join(folder, name), "wb") as out:
        np.array([len(cores)], dtype=np.int64).tofile(out)
        for core in cores:
            np.array(core.shape, dtype=np.int64).tofile(out)
            core.flatten(order="F").tofile(out)


def added(terms):
    """The block-diagonal sum of trains of (r, n, r') cores."""
    import numpy as np
    d, cores = len(terms[0]), []
    for k in range(d):
        parts = [term[k] for term in terms]
        left = 1 if k == 0 else sum(p.shape[0] for p in parts)
        right = 1 if k + 1 == d else sum(p.shape[2] for p in parts)
        core, row, column = np.zeros((left, parts[0].shape[1], right)), 0, 0
        for p in parts:
            core[row : row + p.shape[0], :, column : column + p.shape[2]] += p
            row, column = (0 if k == 0 else row + p.shape[0]), (0 if k + 1 == d else column + p.shape[2])
        cores.append(core)
    return cores


def write_trains(folder):
    """The trains of the Rust bench as files for Octave."""
    import numpy as np
    for name, sizes in {
        "x": (20, 4, 32, 1_000_000), "y": (20, 4, 32, 2_000_000), "a": (20, 4, 8, 3_000_000),
        "b": (20, 4, 8, 4_000_000), "operator": (20, 4, 4, 5_000_000), "small": (20, 2, 16, 6_000_000),
        "matrix": (16, 4, 10, 7_000_000), "start2": (12, 2, 4, 9_000_000), "start3": (18, 2, 4, 9_000_000),
    }.items():
        write_train(folder, name, train(*sizes))
    for dimension in (2, 3):
        flat = lambda c: c.reshape((c.shape[0], 4, c.shape[3]), order="F")
        terms = [[flat(c) for c in term] for term in poisson_cores(dimension)]
        write_train(folder, f"poisson{dimension}", added(terms))
        write_train(folder, f"ones{dimension}", [np.ones((1, 2, 1))] * (6 * dimension))


def lines(command, threads, extra=None, **options):
    """Results of a process that prints JSON lines, with the number of threads of every library fixed."""
    names = ["RAYON", "OMP", "OPENBLAS", "MKL", "NUMEXPR"]
    environment = dict(os.environ, **{f"{name}_NUM_THREADS": str(threads) for name in names}, **(extra or {}))
    done = subprocess.run(command, env=environment, capture_output=True, text=True, **options)
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    if not rows:
        print(f"({command[0]}: no results: {done.stderr.strip()[-300:]})")
    return {row["operation"]: row for row in rows}


def has(module):
    code = f"import {module}"
    return subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def octave_is_there():
    return os.environ.get("TT_TOOLBOX") and subprocess.run(["which", "octave"], capture_output=True).returncode == 0


def table(threads):
    ours = lines(["cargo", "bench", "-q", "-p", "graintrain-tt", "--bench", "operations"], threads, cwd=ROOT)
    peers = {}
    for name in ("teneva", "torchtt"):
        if has(name):
            peers[name] = lines([sys.executable, __file__, "--peer", name, str(threads)], threads)
        else:
            print(f"({name} is not installed)")
    if octave_is_there():
        with tempfile.TemporaryDirectory() as folder:
            write_trains(folder)
            script = os.path.join(folder, "bench.m")
            with open(script, "w") as out:
                out.write("1;\n" + OCTAVE)
            peers["TT-Toolbox"] = lines(["octave", "--no-gui", "-q", script], threads, {"TRAINS": folder})
    else:
        print("(TT-Toolbox: octave or TT_TOOLBOX is missing)")
    print(f"\n{threads} thread(s); milliseconds (error), ratio = peer / graintrain-tt\n")
    print("| operation | graintrain-tt |" + "".join(f" {name} | ratio |" for name in peers))
    print("|---|---|" + "---|---|" * len(peers))
    for name, row in ours.items():
        cells = [name, f"{1e3 * row['seconds']:.3g} ({row['error']:.1e})"]
        for peer in peers.values():
            other = peer.get(name, {})
            if "seconds" in other:
                cells += [f"{1e3 * other['seconds']:.3g} ({other['error']:.1e})", f"{other['seconds'] / row['seconds']:.1f}"]
            else:
                cells += ["failed" if "failed" in other else "-", ""]
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--peer"]:
        run_teneva() if sys.argv[2] == "teneva" else run_torchtt(int(sys.argv[3]))
    else:
        for count in [int(x) for x in sys.argv[1:]] or [1, 2]:
            table(count)
