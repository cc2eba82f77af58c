"""A robot finds its way by touch alone: a post stands in the way that it cannot see; ends with where it is."""

import numpy as np

import palpate

GOAL, POST = np.array([1.2, 0.0]), np.array([0.6, 0.01])  # m
RADIUS, WIDE, TRACK, RATE = 0.055, 0.08, 0.085, 30.0  # m, m, m between the tracks, Hz

navigator = palpate.TouchNavigator(goal=(1.2, 0.0), drive=palpate.DifferentialDrive(track=TRACK, top=0.05))
pose = np.array([0.2, 0.0, 0.0])  # x, y [m] and heading [rad]
state, longest = "", 0.0

for step in range(round(120 * RATE)):
    # The skin: a soft one of 500 N/m that is pressed by as much as robot and post overlap.
    away = POST - pose[:2]
    gap = np.linalg.norm(away) - RADIUS - WIDE
    angle = np.arctan2(away[1], away[0]) - pose[2]
    touches = np.array([[angle, -500.0 * gap]]) if gap < 0.0 else np.zeros((0, 2))
    longest = max(longest, -500.0 * gap)

    left, right = navigator.update(step / RATE, touches, pose)
    if navigator.state != state:
        state = navigator.state
        print(f"{step / RATE:5.1f} s  {state}: {navigator.why}")
    if state == "arrived":
        break

    # The robot drives as told; the post stands fast, and gives way by 4 mm.
    speed, turn = (left + right) / 2.0, (right - left) / TRACK
    pose = pose + np.array([speed * np.cos(pose[2]), speed * np.sin(pose[2]), turn]) / RATE
    apart = np.linalg.norm(pose[:2] - POST)
    pose[:2] = POST + (pose[:2] - POST) * max(1.0, (RADIUS + WIDE - 0.004) / apart)

print(f"{1e3 * np.linalg.norm(pose[:2] - GOAL):.0f} mm from the goal, pressed with {longest:.1f} N at most")
