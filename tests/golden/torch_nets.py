"""The nets as PyTorch modules, with the names of weights that the library writes."""
import torch
import torch.nn as nn
import torch.nn.functional as F


class UNet(nn.Module):
    """down, up: lists of lists of widths; up_by: "linear", "nearest", "transposed"; shared: one net of one channel for
    all `channels`, with a batch norm for each of them."""

    def __init__(self, channels, down, up, up_by="linear", shared=False, norm=False, last_kernel=1, last_relu=False):
        super().__init__()
        self.up_by, self.shared, self.last_relu, self.channels = up_by, shared, last_relu, channels
        width = 1 if shared else channels
        self.down, self.up, self.lift = nn.ModuleList(), nn.ModuleDict(), nn.ModuleDict()
        for level in down:
            self.down.append(nn.ModuleList())
            for out in level:
                self.down[-1].append(nn.Conv2d(width, out, 3, padding=1))
                width = out
        for level, widths in zip(range(len(down) - 2, -1, -1), up):
            skip = down[level][-1]
            if up_by == "transposed":
                self.lift[str(level)] = nn.ConvTranspose2d(width, skip, 2, stride=2)
                width = skip
            width += skip
            self.up[str(level)] = nn.ModuleList()
            for out in widths:
                self.up[str(level)].append(nn.Conv2d(width, out, 3, padding=1))
                width = out
        self.norm = None
        if norm:
            self.norm = nn.ModuleList(nn.BatchNorm2d(width) for _ in range(channels)) if shared and channels > 1 \
                else nn.BatchNorm2d(width)
        self.last = nn.Conv2d(width, 1 if shared else channels, last_kernel, padding=last_kernel // 2)

    def one(self, x, colours):
        skips = []
        for i, level in enumerate(self.down):
            if i:
                x = F.max_pool2d(x, 2)
            for conv in level:
                x = F.relu(conv(x))
            skips.append(x)
        for i in range(len(self.down) - 2, -1, -1):
            skip = skips[i]
            if self.up_by == "transposed":
                x = self.lift[str(i)](x)
                x = F.pad(x, (0, skip.shape[3] - x.shape[3], 0, skip.shape[2] - x.shape[2]))
            else:
                mode = dict(mode="bilinear", align_corners=False) if self.up_by == "linear" else dict(mode="nearest")
                x = F.interpolate(x, size=skip.shape[2:], **mode)
            x = torch.cat([skip, x], 1)
            for conv in self.up[str(i)]:
                x = F.relu(conv(x))
        if isinstance(self.norm, nn.ModuleList):
            x = torch.stack([norm(part) for norm, part in zip(self.norm, x.unflatten(0, (-1, colours)).unbind(1))],
                            1).flatten(0, 1)
        elif self.norm is not None:
            x = self.norm(x)
        x = self.last(x)
        return F.relu(x) if self.last_relu else x

    def forward(self, x):
        if not self.shared:
            return self.one(x, 1)
        images, colours, rows, cols = x.shape
        return self.one(x.reshape(images * colours, 1, rows, cols), colours).reshape(images, colours, rows, cols)


def widths(text):
    return [[int(w) for w in level.split(",") if w] for level in text.split("|")]


def unet(kind, channels):
    """The net of a preset, or of a text such as "8,8|16,16/16,8/linear"."""
    if kind == "compact":
        return UNet(channels, widths("16,16|32,32|64,64|128,128|256,256"), widths("128,128|64,64|32,32|16,16"))
    if kind == "paper":
        return UNet(channels, widths("32,32|64|64|128|256|512,256,128"), widths("128|64|32|32|"), shared=True,
                    norm=True, last_kernel=3, last_relu=True)
    parts = kind.split("/")
    up = parts[1] if len(parts) > 1 else ""
    extra = len(parts) > 3
    return UNet(channels, widths(parts[0]), widths(up) if up or "|" in parts[0] else [],
                parts[2] if len(parts) > 2 else "linear", shared=extra, norm=extra, last_kernel=3 if extra else 1,
                last_relu=extra)


class Discriminator(nn.Module):
    def __init__(self, channels):
        super().__init__()
        sizes = [channels, 32, 64, 128, 128, 128]
        self.conv = nn.ModuleList(nn.Conv2d(a, b, 3, stride=2, padding=1) for a, b in zip(sizes, sizes[1:]))
        self.full = nn.ModuleList([nn.Linear(128 * 8 * 8, 256), nn.Linear(256, 1)])

    def forward(self, x):
        x = F.interpolate(x, size=(256, 256), mode="bilinear", align_corners=False)
        for conv in self.conv:
            x = F.leaky_relu(conv(x), 0.2)
        x = F.leaky_relu(self.full[0](torch.flatten(x, 1)), 0.2)
        return self.full[1](x)[:, :, None, None]


class Patches(nn.Module):
    def __init__(self, channels):
        super().__init__()
        sizes, strides = [channels, 32, 64, 128, 128, 1], [1, 2, 2, 1, 1]
        self.conv = nn.ModuleList(nn.Conv2d(a, b, 3, stride=s, padding=1) for a, b, s in zip(sizes, sizes[1:], strides))

    def forward(self, x):
        for conv in self.conv[:-1]:
            x = F.leaky_relu(conv(x), 0.2)
        return self.conv[-1](x)


class VGG16(nn.Module):
    """The `features` of torchvision.models.vgg16 behind the normalisation of its weights."""

    def __init__(self):
        super().__init__()
        self.normalize = nn.Conv2d(3, 3, 1)
        layers, width = [], 3
        for out in (64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512, 0):
            layers += [nn.Conv2d(width, out, 3, padding=1), nn.ReLU()] if out else [nn.MaxPool2d(2)]
            width = out or width
        self.features = nn.Sequential(*layers)

    def forward(self, x):
        return self.features(self.normalize(x))
