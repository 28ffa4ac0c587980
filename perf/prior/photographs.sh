#!/bin/sh
# Brings the photographs that the ridge regulariser learns from: photographs.sh FOLDER
# They are wallpapers of Debian packages, under CC-BY, CC-BY-SA and GPL-2+ (each package's copyright file says which).
set -eu
folder=${1:?usage: photographs.sh FOLDER}
mkdir -p "$folder/packages"
cd "$folder/packages"
apt-get download lomiri-wallpapers-16.04 lomiri-wallpapers-20.04 mate-backgrounds plasma-workspace-wallpapers
for package in *.deb; do dpkg -x "$package" .; done
mv usr/share/backgrounds/*.jpg usr/share/backgrounds/mate/nature/*.jpg ..
for name in Path DarkestHour Autumn summer_1am EveningGlow Grey Kite ColorfulCups ColdRipple; do
    mv "usr/share/wallpapers/$name/contents/images/2560x1600.jpg" "../$name.jpg"
done
# these are for tests, or show noise
cd ..
rm -rf packages Garden.jpg analogpattern*.jpg Painting-Colors*.jpg
