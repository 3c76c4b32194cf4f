import sys,re
T=[];dead=0
for fn in sys.argv[1:]:
    low=None;t=0
    for l in open(fn):
        m=re.match(r'\+([\d.]+)s',l)
        if not m: continue
        t=float(m.group(1))
        if 'stops and goes home' in l: low=t
        if 'on the station' in l and low is not None: T.append(t-low);low=None
    if low is not None and t-low>300: dead+=1
T.sort();n=len(T)
print(n,'dockings, dead',dead,[round(T[min(n-1,int(n*f))]) for f in(.1,.25,.5,.75,.9,.95,.98,.99,.999)],'> 60 s %.1f%%'%(100*sum(x>60 for x in T)/n),'>110 s %.1f%%'%(100*sum(x>110 for x in T)/n),'>200 %.1f%%'%(100*sum(x>200 for x in T)/n))
