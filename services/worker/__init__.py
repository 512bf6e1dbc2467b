"""Parts that workers of several services share: their skeleton, stamp joiner, rate limiter and thread.

How workers share cameras: bus/sharing.
"""
