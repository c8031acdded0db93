#!/bin/sh
# From nothing to a denoiser of one's own: renders 40 scenes, trains a small kernel-prediction model,
# exports it as integers, denoises a picture that it has never seen, and checks that it gains 5 dB at
# 4 samples per pixel. About half an hour on one core; `make train-demo` runs it.
#
#   demo/train.sh BUILD PYTHON
#
# Environment: DEMO_DIR (default BUILD/train-demo), DEMO_SCENES (36 to train on, 4 are held out),
# DEMO_TIME (10m). Everything is resumed if it is run again.
set -eu

cd "$(dirname "$0")/.."
build=$1 python=$2
dir=${DEMO_DIR:-$build/train-demo}
scenes=${DEMO_SCENES:-36}
time=${DEMO_TIME:-10m}

run() {
    echo "+ $*"
    "$@"
}

# 1. Scenes. The last four seeds are only looked at.
for set in "train 0:$scenes" "valid 90000:90004"; do
    run "$python" -m training.scenes.render "$dir/data/${set% *}" --seeds "${set#* }" \
        --size 128 --spp 1,4,16 --ref 128
done

# 2. Train. 3. Export.
run "$python" -m training.train hdr alb nrm --raw -D "$dir/data" -t train -v valid -R "$dir/results" \
    -r k12 -m k12 --tile_size 64 --batch_size 8 --num_valid_epochs 25 --num_save_epochs 25 \
    --exposure_jitter 2 --average_inputs 0.1 --mix_clean_aux 0.1 --num_loaders 1 \
    --time-budget "$time" --seed 1
run "$python" -m training.export -R "$dir/results" -r k12 --best --int8 -o "$dir/k12.tza"

# 4. Denoise.
noisy=$dir/data/valid/s90000/s90000_0004spp
run "$build/bin/oidnDenoise" --hdr "$noisy.hdr.exr" --alb "$noisy.alb.exr" --nrm "$noisy.nrm.exr" \
    -w "$dir/k12.tza" -o "$dir/denoised.exr"

# What it gained on the scenes that were held out.
run "$python" -m training.evaluate "$dir/k12.tza=hdr,alb,nrm" --images "$dir/data/valid" --no_oidn \
    --metric psnr ssim --json "$dir/scores.json" --least_gain 5 --spp 4
