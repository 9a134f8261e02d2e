"""Writes the goldens of this folder: what PyTorch says about seeded networks and a made-up picture.

Usage: python make_golden.py      (needs torch, numpy, safetensors; the tests do not)
`tiny_*.model.safetensors` are model files; the full-width networks of `compact` and `vgg16` are filled by the formula of
`network.numbers`, which the test repeats, so that no large file is kept.
"""
import os
import numpy as np
import torch
import torch.nn.functional as F
from safetensors.numpy import save_file
from network import Network, compact, fill, metadata, stored, tiny, vgg16, vgg16_paper

HEIGHT, WIDTH, THRESHOLD, RADIUS, MAX, MARGIN = 64, 96, 0.03, 2, 60, 4
HERE = os.path.dirname(os.path.abspath(__file__))


def picture():
    random = np.random.default_rng(5)
    coarse = torch.from_numpy(random.uniform(0, 255, (1, 3, HEIGHT // 8, WIDTH // 8)))
    fine = F.interpolate(coarse, size=(HEIGHT, WIDTH), mode='bicubic')[0].permute(1, 2, 0).numpy()
    return np.clip(fine + random.normal(0, 25, fine.shape), 0, 255).astype(np.uint8)


def mask():
    "A rotated square, as a rotated photo leaves."
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return ((np.abs(x - 50 + .3 * (y - 30)) < 36) & (np.abs(y - 30 - .3 * (x - 50)) < 26)).astype(np.uint8) * 255


def answers(spec, values, image, domain, instance=False, shown=None):
    net = Network(spec, values, domain, instance, None if shown is None else torch.from_numpy(shown > 0)).eval()
    x = (torch.from_numpy(image.astype(np.float32) / 255) - torch.tensor(spec['input_mean'])) / torch.tensor(spec['input_std'])
    if shown is not None:
        x = x * torch.from_numpy(shown > 0)[..., None]
    logits, descriptors, vector = net(x.permute(2, 0, 1)[None])
    heatmap = F.pixel_shuffle(logits.softmax(1)[:, :64], 8)[0, 0]
    return net, heatmap, descriptors, vector[0]


def keypoints(heatmap, descriptors, shown):
    peak = F.max_pool2d(heatmap[None, None], 2 * RADIUS + 1, 1, RADIUS)[0, 0] == heatmap
    unseen = torch.from_numpy(shown == 0).float()[None, None]
    near = F.max_pool2d(unseen, 2 * MARGIN + 1, 1, MARGIN)[0, 0] > 0
    ys, xs = torch.nonzero(peak & (heatmap > THRESHOLD) & ~near, as_tuple=True)
    order = torch.argsort(heatmap[ys, xs], descending=True)[:MAX]
    ys, xs = ys[order], xs[order]
    at = torch.stack([(xs + .5) / WIDTH * 2 - 1, (ys + .5) / HEIGHT * 2 - 1], -1).float()[None, None]
    sampled = F.normalize(F.grid_sample(descriptors, at, align_corners=False)[0, :, 0].T, dim=1)
    return torch.stack([xs.float(), ys.float(), heatmap[ys, xs]], 1), sampled


def main():
    torch.manual_seed(0)
    cases = {
        'tiny_compact': (tiny(compact(), (4, 8, 16, 20, 24), 16, 6, 32), 'uav'),
        'tiny_vgg16': (tiny(vgg16(), (4, 8, 12, 16, 24), 20, 5, 0), 'sat'),
        'tiny_vgg16_paper': (tiny(vgg16_paper(), (4, 8, 12, 16, 24), 20, 5, 0), 'sat'),
        'compact': (compact(), 'sat'),
        'vgg16': (vgg16(), 'uav'),
    }
    image, shown = picture(), mask()
    for name, (spec, domain) in cases.items():
        values = fill(spec)
        with torch.no_grad():
            _, heatmap, descriptors, vector = answers(spec, values, image, domain)
            points, sampled = keypoints(heatmap, descriptors, shown)
            out = {
                'image': image, 'mask': shown, 'heatmap': heatmap, 'descriptors': descriptors[0].permute(1, 2, 0), 'global': vector,
                'keypoints': points, 'keypoint_descriptors': sampled,
            }
            # Only of narrow networks: some of 128 channels vary by almost nothing over the few places that H/32 has here, and
            # dividing by that makes single precision visible.
            if name.startswith('tiny'):
                net, heatmap, descriptors, vector = answers(spec, values, image, domain, True, shown)
                moments = net.moments.values()
                out |= {
                    'instance.heatmap': heatmap, 'instance.descriptors': descriptors[0].permute(1, 2, 0), 'instance.global': vector,
                    'instance.mean': torch.cat([m for m, _ in moments]), 'instance.var': torch.cat([v for _, v in moments]),
                }
        out = {k: np.ascontiguousarray(v if isinstance(v, np.ndarray) else v.numpy()) for k, v in out.items()}
        save_file(out, f'{HERE}/{name}.safetensors')
        if name.startswith('tiny'):
            save_file(stored(values), f'{HERE}/{name}.model.safetensors', metadata(spec, name))
        p = out['keypoints']
        print(name, {k: v.shape for k, v in out.items()}, 'peak', out['heatmap'].max(), 'keypoints', len(p),
              'score range', p[:, 2].max(), p[:, 2].min(), 'least relative gap', float(np.min(-np.diff(p[:, 2]) / p[1:, 2])))


if __name__ == '__main__':
    main()
