"""Values and gradients of the trainer's losses and of its normalisation, by PyTorch: writes losses.json beside this file.

Run with a Python that has torch: `python make_golden.py`. Each loss is written here from its equation, with autograd for the
gradient, and none of it is taken from the trainer.
"""
import json
from pathlib import Path

import torch
import torch.nn.functional as F

torch.manual_seed(20)
CASES = {}


def unit(*shape):
    return F.normalize(torch.randn(*shape), dim=-1)


def case(name, inputs, loss, **extra):
    """Records inputs, the loss's value, and its gradient with respect to every input."""
    leaves = {key: value.clone().requires_grad_() for key, value in inputs.items()}
    value = loss(**leaves)
    value.backward()
    flat = lambda t: [float(f"{v:.8g}") for v in t.detach().flatten().tolist()]
    CASES[name] = {
        "inputs": {key: {"shape": list(t.shape), "values": flat(t)} for key, t in inputs.items()},
        "value": value.item(),
        "gradients": {key: flat(t.grad) for key, t in leaves.items()},
        **extra,
    }


# Keypoint cross-entropy (eq. 13), weighted.
cells = 12
labels = torch.randint(0, 65, (cells,))
weights = torch.rand(cells)
weights[3] = 0.0
case(
    "keypoint",
    {"logits": torch.randn(cells, 65)},
    lambda logits: (F.cross_entropy(logits, labels, reduction="none") * weights).sum() / weights.sum(),
    labels=labels.tolist(),
    weights=weights.tolist(),
)

# Triplet on the m hardest negatives (eq. 9).
n, d = 6, 8
excluded = torch.zeros(n, n, dtype=torch.bool)
excluded[0, 1] = excluded[1, 0] = True
excluded[2, [0, 1, 4, 5]] = True  # only one negative is left


def triplet(sat, uav, margin=0.5, hardest=2):
    distance = torch.sqrt(((uav[:, None] - sat[None]) ** 2).sum(-1))
    terms = []
    for i in range(n):
        negatives = [j for j in range(n) if j != i and not excluded[i, j]]
        negatives.sort(key=lambda j: -(uav[i] @ sat[j]).item())
        terms += [torch.relu(distance[i, i] - distance[i, j] + margin) for j in negatives[:hardest]]
    return torch.stack(terms).mean()


def through_unit(loss):
    """Rows are brought to unit length inside, as the network's are: only then is a distance a function of the cosine."""
    return lambda sat, uav: loss(F.normalize(sat, dim=1), F.normalize(uav, dim=1))


near = unit(n, d)
views = {"sat": near, "uav": F.normalize(near + 0.5 * torch.randn(n, d), dim=1)}
case("triplet", views, through_unit(triplet), excluded=excluded.flatten().tolist())


# Multi-similarity, with mining.
def multi_similarity(sat, uav, alpha=2.0, beta=50.0, threshold=0.5, margin=0.1):
    s = uav @ sat.T
    terms = []
    for i in range(n):
        negatives = [s[i, j] for j in range(n) if j != i and not excluded[i, j]]
        hard = [v for v in negatives if v > s[i, i] - margin]
        term = torch.zeros(())
        if negatives and s[i, i] - margin < max(negatives):
            term = term + torch.log1p(torch.exp(-alpha * (s[i, i] - threshold))) / alpha
        if hard:
            term = term + torch.log1p(sum(torch.exp(beta * (v - threshold)) for v in hard)) / beta
        terms.append(term)
    return torch.stack(terms).mean()


confused = F.normalize(unit(1, d) + 0.5 * torch.randn(n, d), dim=1)
views = {"sat": confused, "uav": F.normalize(confused + 0.3 * torch.randn(n, d), dim=1)}
case("multi_similarity", views, through_unit(multi_similarity), excluded=excluded.flatten().tolist())

# InfoNCE with a memory.
memory = unit(5, d)
past = torch.zeros(n, n + 5, dtype=torch.bool)
past[:, :n] = excluded
past[4, n + 2] = True


def info_nce(sat, uav, temperature=1 / 16):
    forth = torch.cat([uav @ sat.T, uav @ memory.T], 1) / temperature
    back = sat @ uav.T / temperature
    eye = torch.eye(n, dtype=torch.bool)
    forth = forth.masked_fill(past & ~F.pad(eye, (0, 5)), -torch.inf)
    # The map side bars a photo where that photo's row bars the map view.
    back = back.masked_fill(excluded & ~eye, -torch.inf)
    own = torch.arange(n)
    return 0.5 * (F.cross_entropy(forth, own) + F.cross_entropy(back, own))


case(
    "global_contrast",
    {"sat": unit(n, d), "uav": unit(n, d)},
    info_nce,
    excluded=past.flatten().tolist(),
    memory=memory.flatten().tolist(),
)

# Dual softmax of local descriptors.
pairs, points = 2, 7


def dual_softmax(a, b, temperature=0.1):
    s = a.view(pairs, points, d) @ b.view(pairs, points, d).transpose(1, 2) / temperature
    p = F.log_softmax(s, 1) + F.log_softmax(s, 2)
    return -0.5 * p.diagonal(dim1=1, dim2=2).mean()


rows = {"a": unit(pairs * points, d), "b": unit(pairs * points, d)}
case("descriptor_contrast", rows, dual_softmax)

# Hinge over all pairs (eq. 16-17).
same = torch.eye(points, dtype=torch.bool).repeat(pairs, 1, 1)
same[0, 2, 3] = same[0, 3, 2] = True


def hinge(a, b, positive=0.9, negative=0.2, weight=1.0):
    s = a.view(pairs, points, d) @ b.view(pairs, points, d).transpose(1, 2)
    return torch.where(same, weight * torch.relu(positive - s), torch.relu(s - negative)).mean()


case("descriptor_hinge", rows, hinge, same=same.flatten().tolist())


# Homography reprojection (eq. 24): soft matches, weighted DLT by a dense solver.
def reprojection(a, b, start, end, side=128.0, temperature=0.3, unit_px=8.0, ridge=1e-3):
    p, q = start / (side / 2) - 1, end / (side / 2) - 1
    s = a.view(pairs, points, d) @ b.view(pairs, points, d).transpose(1, 2) / temperature
    share = torch.softmax(s, 2)
    matched, w = share @ q, share.max(2).values ** 2
    off = []
    for k in range(pairs):
        design, target, weight = [], [], []
        for i in range(points):
            (x, y), (u, v) = p[k, i], matched[k, i]
            zero, one = torch.zeros(()), torch.ones(())
            design += [torch.stack([x, y, one, zero, zero, zero, -u * x, -u * y])]
            design += [torch.stack([zero, zero, zero, x, y, one, -v * x, -v * y])]
            target += [u, v]
            weight += [w[k, i], w[k, i]]
        design, target, weight = torch.stack(design), torch.stack(target), torch.stack(weight)
        weight = weight / weight.mean()
        damping = torch.diag(torch.tensor([ridge * 1e-3] * 6 + [ridge] * 2)) * points
        h = torch.linalg.solve(design.T @ (weight[:, None] * design) + damping, design.T @ (weight * target))
        z = p[k] @ h[6:8] + 1
        carried = torch.stack([p[k] @ h[0:2] + h[2], p[k] @ h[3:5] + h[5]], 1) / z.clamp_min(0.2)[:, None]
        off.append(torch.sqrt(((carried - q[k]) ** 2).sum(1)))
    return torch.stack(off).mean() * side / 2 / unit_px


start = 8 + 112 * torch.rand(pairs, points, 2)
end = 0.9 * start + 5 + 2 * torch.randn(pairs, points, 2)
seen = unit(pairs * points, d)
rows = {"a": seen, "b": F.normalize(seen + 0.3 * torch.randn(pairs * points, d), dim=1)}
case(
    "homography",
    {key: value.double() for key, value in rows.items()},
    lambda a, b: reprojection(a.float(), b.float(), start, end),
    from_px=start.flatten().tolist(),
    to_px=end.flatten().tolist(),
)

# Distillation.
teacher = torch.softmax(torch.randn(cells, 65), 1)
case(
    "keypoint_distillation",
    {"logits": torch.randn(cells, 65)},
    lambda logits: (F.cross_entropy(logits, teacher, reduction="none") * weights).sum() / weights.sum(),
    teacher=teacher.flatten().tolist(),
    weights=weights.tolist(),
)
taught = unit(cells, 5)
case(
    "descriptor_distillation",
    {"student": torch.randn(cells, d)},
    lambda student: ((1 - F.cosine_similarity(student, F.pad(taught, (0, d - 5)))) * weights).sum() / weights.sum(),
    teacher=taught.flatten().tolist(),
    weights=weights.tolist(),
)
known = unit(n, 5)
case(
    "similarity_distillation",
    {"student": unit(n, d)},
    lambda student: F.mse_loss(student @ student.T, known @ known.T),
    teacher=known.flatten().tolist(),
)

# DA-BN (eq. 3) and ReLU: one BatchNorm a domain, with its running statistics.
rows_sat, rows_uav, channels = 9, 14, 5
x = torch.randn(rows_sat + rows_uav, channels) * 2 + 0.5
gamma, beta = torch.rand(2, channels) + 0.5, torch.randn(2, channels)
pull = torch.randn(rows_sat + rows_uav, channels)
old_mean, old_var = torch.randn(2, channels), torch.rand(2, channels) + 0.5
running = {}


def norm(x, gamma, beta):
    out = []
    for k, part in enumerate([x[:rows_sat], x[rows_sat:]]):
        running[k] = (old_mean[k].clone(), old_var[k].clone())
        out.append(F.batch_norm(part, *running[k], gamma[k], beta[k], True, 0.1, 1e-5))
    return (torch.relu(torch.cat(out)) * pull).sum()


case("normalisation", {"x": x, "gamma": gamma, "beta": beta}, norm, pull=pull.flatten().tolist())
CASES["normalisation"]["old"] = [[old_mean[k].tolist(), old_var[k].tolist()] for k in (0, 1)]
CASES["normalisation"]["running"] = [[t.tolist() for t in running[k]] for k in (0, 1)]

# One Adam step after another, two rates, clipped by the global norm.
ENCODER, DECODER = "encoder.0.0.weight", "descriptor.bias"


def adam_case(name, values, pulls, clip, betas):
    """Records the values after one step for each pull, which is the gradient, and the lengths of the gradients."""
    moved = {key: v.clone().requires_grad_() for key, v in values.items()}
    adam = torch.optim.Adam(
        [{"params": [moved[ENCODER]], "lr": 1e-3}, {"params": [moved[DECODER]], "lr": 1e-2}], betas=betas, eps=1e-8
    )
    lengths = []
    for pull in pulls:
        for key, v in moved.items():
            v.grad = pull[key].clone()
        lengths.append(float(torch.nn.utils.clip_grad_norm_(list(moved.values()), clip)))
        adam.step()
    CASES[name] = {
        "start": {key: v.tolist() for key, v in values.items()},
        "pulls": [{key: v.tolist() for key, v in pull.items()} for pull in pulls],
        "end": {key: v.detach().tolist() for key, v in moved.items()},
        "lengths": lengths,
    }


values = {ENCODER: torch.randn(6), DECODER: torch.randn(4)}
pulls = [{key: torch.randn_like(v) * s for key, v in values.items()} for s in (0.1, 3.0, 1.0)]
adam_case("adam", values, pulls, 2.0, (0.9, 0.99))

# Cross-entropy over scene classes, each data set among its own. From its own random numbers, so that the cases before keep theirs.
drawn = torch.Generator().manual_seed(21)
classes = [(1, 0, 4), (3, 0, 4), None, (4, 4, 7), (6, 4, 7)]  # class, first and end of the data set's classes


def scenes(logits):
    known = [(row, *scene) for row, scene in zip(logits, classes) if scene]
    terms = [F.cross_entropy(row[a:b][None], torch.tensor([c - a])) for row, c, a, b in known]
    return torch.stack(terms).mean()


case("scenes", {"logits": 2 * torch.randn(5, 7, generator=drawn)}, scenes, scenes=classes)

# Adam where gradients are hardly larger than its epsilon of 1e-8, which PyTorch adds after the correction of the second moment. From
# its own random numbers, too; small values, so that the steps are not lost in rounding.
drawn = torch.Generator().manual_seed(22)
values = {ENCODER: 0.01 * torch.randn(6, generator=drawn), DECODER: 0.01 * torch.randn(4, generator=drawn)}
pulls = [{key: 1e-7 * torch.randn(v.shape, generator=drawn) for key, v in values.items()} for _ in range(3)]
adam_case("adam_small_gradients", values, pulls, float("inf"), (0.9, 0.999))

path = Path(__file__).parent / "losses.json"
path.write_text(json.dumps(CASES, indent=None, separators=(",", ":")) + "\n")
print(path.stat().st_size, "bytes;", {name: case.get("value") for name, case in CASES.items()})
