import sys,math
for fn in sys.argv[1:]:
    F={};e=[];P={};cut={};res={'True':[], 'False':[]}
    for l in open(fn):
        a=l.split()
        if len(a)<5: continue
        if a[0]=='P': P[a[1]]=tuple(map(float,a[2:7]))
        elif a[0]=='E' and a[3]=='Log' and a[4]=='CUT': cut[a[1]]=a[5].capitalize()
        elif a[0]=='E' and a[3]=='Log' and a[4]=='X' and a[1] in P:
            k=a[1];h=float(a[7]);th=P[k][3]
            if k in F:
                d=((h-th-F[k]+math.pi)%(2*math.pi)-math.pi)
                res[cut.get(k,'False')].append(abs(math.degrees(d)))
            F[k]=h-th
    for c,s in res.items():
        s.sort();n=len(s)
        if n: print(fn[-20:],'cut',c,n,'heading step error',[round(s[min(n-1,int(n*f))],1) for f in(.1,.25,.5,.75,.9,.95)],'>30: %.1f%%'%(100*sum(x>30 for x in s)/n))
