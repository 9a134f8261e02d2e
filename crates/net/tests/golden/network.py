"""The network in PyTorch, written from the paper and the description, independent of the Rust code. Also exported to ONNX by
benches/peers. Parameters carry the names of the model file; `specs()` gives the descriptions used by the goldens.
"""
import json
import numpy as np
import torch
import torch.nn.functional as F

EPSILON = 1e-5


def compact():
    return {
        'preset': 'compact', 'input_mean': [0.45] * 3, 'input_std': [0.25] * 3,
        'stages': [{'widths': [w, w], 'downsample': 'stride_first'} for w in (16, 48, 128, 128, 128)],
        'decoder': {'lateral': {'width': 128}}, 'descriptor_dim': 128,
        'keypoints': {'from_grey': {'width': 64, 'layers': 3}},
        'vlad': {'input': 'descriptors', 'clusters': 64}, 'global_dim': 1024,
    }


def vgg16():
    return {
        'preset': 'vgg16', 'input_mean': [0.485, 0.456, 0.406], 'input_std': [0.229, 0.224, 0.225],
        'stages': [{'widths': [w] * n, 'downsample': 'max_pool_last'} for w, n in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3))],
        'decoder': {'transposed': {'width': 512}}, 'descriptor_dim': 256, 'keypoints': 'from_decoder',
        'vlad': {'input': 'deepest', 'clusters': 64}, 'global_dim': 512,
    }


def vgg16_paper():
    "As published: transposed convolutions alone (eq. 4), NetVLAD on the features as they are (eq. 5-6)."
    spec = vgg16()
    return {**spec, 'preset': 'vgg16-paper', 'decoder': {'transposed_plain': {'width': 512}},
            'vlad': {**spec['vlad'], 'input': 'deepest_unscaled'}}


def tiny(spec, widths, decoder, clusters, global_dim):
    "The same network with narrow layers."
    for stage, width in zip(spec['stages'], widths):
        stage['widths'] = [width] * len(stage['widths'])
    spec['decoder'] = {k: {'width': decoder} for k in spec['decoder']}
    if spec['keypoints'] != 'from_decoder':
        spec['keypoints'] = {'from_grey': {'width': 20, 'layers': 2}}
    return {**spec, 'descriptor_dim': 24, 'vlad': {**spec['vlad'], 'clusters': clusters}, 'global_dim': global_dim}


def parameters(spec):
    "Names and shapes, in the order of the model file's description."
    out, c = {}, 3

    def norm(layer, n):
        for domain in ('sat', 'uav'):
            for part in ('weight', 'bias', 'mean', 'var'):
                out[f'{layer}.norm.{domain}.{part}'] = [n]
    for s, stage in enumerate(spec['stages']):
        for i, n in enumerate(stage['widths']):
            out[f'encoder.{s}.{i}.weight'] = [n, c, 3, 3]
            norm(f'encoder.{s}.{i}', n)
            c = n
    kind, decoder = next(iter(spec['decoder'].items()))
    d, w = spec['descriptor_dim'], decoder['width']
    if kind == 'lateral':
        for name, s in (('lateral.h16', 3), ('lateral.h32', 4)):
            out[f'{name}.weight'] = [w, spec['stages'][s]['widths'][-1], 1, 1]
            out[f'{name}.bias'] = [w]
        out['fuse.weight'] = [w, w, 3, 3]
        norm('fuse', w)
    else:
        for i, n in enumerate((c, w)):
            out[f'upsample.{i}.weight'] = [n, w, 4, 4]
            if kind == 'transposed_plain':
                out[f'upsample.{i}.bias'] = [w]
            else:
                norm(f'upsample.{i}', w)
    k = 1 if kind == 'lateral' else 3
    out['descriptor.weight'], out['descriptor.bias'] = [d, w, k, k], [d]
    if spec['keypoints'] == 'from_decoder':
        out['keypoint.weight'], out['keypoint.bias'] = [65, w, 3, 3], [65]
    else:
        head, n = spec['keypoints']['from_grey'], 64
        for i in range(head['layers']):
            out[f'keypoint.{i}.weight'] = [head['width'], n, 1, 1]
            norm(f'keypoint.{i}', head['width'])
            n = head['width']
        out['keypoint.out.weight'], out['keypoint.out.bias'] = [65, n, 1, 1], [65]
    K, D = spec['vlad']['clusters'], c if spec['vlad']['input'].startswith('deepest') else d
    out['netvlad.assign.weight'], out['netvlad.assign.bias'], out['netvlad.centres'] = [K, D], [K], [K, D]
    if spec['global_dim'] not in (0, K * D):
        out['whitening.mean'], out['whitening.projection'] = [K * D], [spec['global_dim'], K * D]
    return out


def numbers(name, count):
    """`count` numbers in -1..1 that depend on nothing but the name and the index (FNV-1a, then splitmix64), so that the Rust
    test makes the same ones: odd multiples of 1/2048, exact in half precision."""
    seed = 0xcbf29ce484222325
    for byte in name.encode():
        seed = (seed ^ byte) * 0x100000001b3 % 2**64
    with np.errstate(over='ignore'):
        z = np.uint64(seed) + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9e3779b97f4a7c15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xbf58476d1ce4e5b9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94d049bb133111eb)
        z = z ^ (z >> np.uint64(31))
    return (2 * (z >> np.uint64(53)).astype(np.float32) - 2047) / 2048


def fill(spec):
    "The numbers of a network: all exact in half precision where the model file stores halves."
    out = {}
    for name, shape in parameters(spec).items():
        v = numbers(name, int(np.prod(shape))).reshape(shape)
        if len(shape) == 4:
            fan_in = shape[0] * 4 if name.startswith('upsample') else shape[1] * shape[2] * shape[3]
            v = v * 2.0 ** np.round(np.log2(np.sqrt(6 / fan_in)) + {'keypoint.weight': -2, 'keypoint.out.weight': 2}.get(name, 0))
        elif name == 'netvlad.assign.weight':
            v = v * 4
        elif name == 'whitening.projection':
            v = v / 32
        elif name == 'whitening.mean':
            v = v / 128
        elif '.norm.' in name and name.endswith(('.weight', '.var')):
            v = 1 + v / 2
        elif name != 'netvlad.centres':
            v = v / 4
        out[name] = v.astype(np.float32)
    return out


class Network(torch.nn.Module):
    """`forward` gives keypoint logits (B x 65 x H/8 x W/8), descriptors (B x D x H/8 x W/8, not of unit length) and the global
    descriptor (B x G). `x` is the normalised picture, B x 3 x H x W.

    `instance` normalises by the picture's own moments, over the places that `mask` (H x W) shows, and keeps them in `moments`.
    """
    def __init__(self, spec, values, domain, instance=False, mask=None):
        super().__init__()
        self.spec, self.domain, self.instance, self.mask, self.moments = spec, domain, instance, mask, {}
        self.names = {name: name.replace('.', '_') for name in values}
        for name, v in values.items():
            self.register_buffer(self.names[name], torch.as_tensor(v))

    def value(self, name):
        return getattr(self, self.names[name])

    def seen(self, x):
        "The mask at the resolution of `x`: places of which at least half the pixels are seen."
        pitch = self.mask.shape[0] // x.shape[2]
        return F.avg_pool2d(self.mask[None, None].double(), pitch)[0, 0] >= 0.5

    def norm(self, x, layer):
        gamma, beta, mean, var = (self.value(f'{layer}.norm.{self.domain}.{p}') for p in ('weight', 'bias', 'mean', 'var'))
        if self.instance:
            v = x[0].flatten(1) if self.mask is None else x[0][:, self.seen(x)]
            if v.shape[1]:
                mean, var = v.double().mean(1).float(), v.double().var(1, unbiased=False).float()
            self.moments[layer] = (mean, var)
        return F.relu(F.batch_norm(x, mean, var, gamma, beta, eps=EPSILON))

    def conv(self, x, layer, stride=1):
        w = self.value(f'{layer}.weight')
        bias = self.value(f'{layer}.bias') if f'{layer}.bias' in self.names else None
        return F.conv2d(x, w, bias, stride, w.shape[-1] // 2)

    def forward(self, x):
        spec, features = self.spec, []
        grey = F.pixel_unshuffle(x.mean(1, keepdim=True), 8)
        for s, stage in enumerate(spec['stages']):
            first = stage['downsample'] == 'stride_first'
            for i in range(len(stage['widths'])):
                x = self.norm(self.conv(x, f'encoder.{s}.{i}', 2 if first and i == 0 else 1), f'encoder.{s}.{i}')
            x = x if first else F.max_pool2d(x, 2)
            features.append(x)
        if 'lateral' in spec['decoder']:
            u = self.conv(features[3], 'lateral.h16')
            u = u + F.interpolate(self.conv(features[4], 'lateral.h32'), size=u.shape[2:], mode='bilinear')
            u = features[2] + F.interpolate(u, size=features[2].shape[2:], mode='bilinear')
            u = self.norm(self.conv(u, 'fuse'), 'fuse')
        else:
            u = x
            for i in range(2):
                plain = 'transposed_plain' in spec['decoder']
                bias = self.value(f'upsample.{i}.bias') if plain else None
                u = F.conv_transpose2d(u, self.value(f'upsample.{i}.weight'), bias, 2, 1)
                u = u if plain else self.norm(u, f'upsample.{i}')
        descriptors = self.conv(u, 'descriptor')
        if spec['keypoints'] == 'from_decoder':
            logits = self.conv(u, 'keypoint')
        else:
            for i in range(spec['keypoints']['from_grey']['layers']):
                grey = self.norm(self.conv(grey, f'keypoint.{i}'), f'keypoint.{i}')
            logits = self.conv(grey, 'keypoint.out')
        return logits, descriptors, self.vlad(x if spec['vlad']['input'].startswith('deepest') else descriptors)

    def vlad(self, x):
        u = x if self.spec['vlad']['input'] == 'deepest_unscaled' else F.normalize(x, dim=1)
        a = F.conv2d(u, self.value('netvlad.assign.weight')[..., None, None], self.value('netvlad.assign.bias')).softmax(1)
        if self.mask is not None:
            a = a * self.seen(x)
        a, u = a.flatten(2), u.flatten(2)
        v = a @ u.transpose(1, 2) - a.sum(-1)[..., None] * self.value('netvlad.centres')
        v = F.normalize(F.normalize(v, dim=2).flatten(1), dim=1)
        if 'whitening.mean' in self.names:
            v = F.normalize((v - self.value('whitening.mean')) @ self.value('whitening.projection').T, dim=1)
        return v


def metadata(spec, name):
    card = {'name': name, 'training_data': 'none', 'steps': 0, 'licence': 'MIT OR Apache-2.0', 'notes': 'for tests', 'random': True}
    return {'grimnet_model_version': '1', 'spec': json.dumps(spec), 'card': json.dumps(card)}


def stored(values):
    "As the model file stores them: convolution weights and the projection as halves."
    return {n: v.astype(np.float16) if v.ndim == 4 or n == 'whitening.projection' else v for n, v in values.items()}
